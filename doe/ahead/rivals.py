"""Which causes are rivals still: what the poses to come are to decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.contest import Entrant
from calib.diagnosis.stage import Fit, positions
from calib.diagnosis.stepwise import linear_scores
from calib.effects.base import Base
from calib.effects.protocol import Effect
from calib.identification import Identification
from calib.instruments import Camera
from calib.linear import LinearProblem
from calib.observations import Points
from doe.ahead.evidence import RivalEvidence
from doe.ahead.likeness import SURE
from doe.ahead.situation import Situation, situation_of
from doe.problem.linearisation import Linearisation

_SOMETHING = 1.0  # noise variances that a rival must explain to be one
_REACH = 25.0
"""Gain by which a rival may trail and still be in reach: at a predicted probability of 0.95 two
standard deviations above the mean."""
_NEAREST = 3  # rivals of a cause that stands alone
_MOST = 5  # rivals in one place: ten pairs


@dataclass(frozen=True, eq=False)
class Rivalry:
    """Causes that compete for one place among the effects found; the others stay as they are.

    members : tuple of Candidate
    declared : whether the diagnosis itself could not tell them apart
    """

    members: tuple[Candidate, ...]
    declared: bool

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Positions of all two that compete; where nothing is in doubt, the first and each other."""
        count = len(self.members)
        first = range(count) if self.declared else range(1)
        return tuple((i, j) for i in first for j in range(i + 1, count))


def rivalries(diagnosis: Diagnosis) -> tuple[Rivalry, ...]:
    """The places in doubt: classes of several members, else causes with a rival in reach.

    Causes by name only: a curve bends to whatever is there, so that no pose tells it from its rivals.
    """
    if suspicious(diagnosis):
        return _suspected(diagnosis)
    curves = [c for c in diagnosis.outcome.active if not c.named]
    chosen = [*(cause.named.candidate for cause in diagnosis.causes), *curves]
    ambiguous = any(len(cause.named.causes) > 1 for cause in diagnosis.causes)
    found = []
    for cause in diagnosis.causes:
        members = list(cause.named.causes)
        declared = len(members) > 1
        if not declared and not ambiguous:
            members = [cause.named.candidate, *_near(cause.named.entry, chosen)]
        if len(members) > 1:
            found.append(Rivalry(tuple(members[:_MOST]), declared))
    return tuple(found)


def suspicious(diagnosis: Diagnosis) -> bool:
    """Whether something is there that nothing found accounts for, by name or without."""
    nothing = not diagnosis.causes and not diagnosis.outcome.active
    return nothing and diagnosis.verdict == "unknown"


def _suspected(diagnosis: Diagnosis) -> tuple[Rivalry, ...]:
    """Where something is there and nothing is found, the causes that explain most of it."""
    view = diagnosis.outcome.view.by_instrument
    named = [c for c in view.suspects if c.named and not c.echo]
    scores = linear_scores(view.complement, view, named)
    leading = sorted(named, key=lambda c: -scores[c.key].gain)[:_MOST]
    return (Rivalry(tuple(leading), True),) if len(leading) > 1 else ()


def _near(entry: Entrant, chosen: Sequence[Candidate]) -> list[Candidate]:
    """Rivals by name whose gain comes close."""
    taken = {c.key for c in chosen}
    top = entry.rivals[0][1]
    near = [c for c, gain in entry.rivals if gain > top - _REACH and c.key not in taken]
    return [c for c in near if c.named and not c.echo][:_NEAREST]


def situation_after(cell: Cell, diagnosis: Diagnosis, rivals: Sequence[Effect]) -> Situation:
    """The data's own situation, linearised at the final fit; ``rivals`` beyond it at zero."""
    after = diagnosis.after
    model, values = after.model.extended(after.values, rivals)
    arm = replace(after.variances, scale=diagnosis.noise.factor)
    return situation_of(Linearisation(as_found(cell, after), model, values, arm), diagnosis.data)


def as_found(cell: Cell, after: Fit | Identification) -> Cell:
    """The cell with its cameras where they were found: what they see of other poses hangs on that."""
    if not any(isinstance(i, Camera) for i in cell.instruments):
        return cell
    effects = zip(after.model.effects, after.model.slices, strict=True)
    places = {e.where: after.values[part] for e, part in effects if isinstance(e, Base)}
    found = (i.found_at(places[i.name]) if i.name in places else i for i in cell.instruments)
    markers = after.model.marker_positions(after.values)
    return replace(cell, instruments=tuple(found), markers=markers)


def data_rows(situation: Situation, diagnosis: Diagnosis) -> tuple[Array, Array]:
    """Residual (N,) and independent rows (N, p) of the data, as the final fit weighs them."""
    data, after, stage = diagnosis.data, diagnosis.after, diagnosis.stage
    W = stage.weights / diagnosis.scale * (after.weight * ~stage.dropped)[:, None, None, None]
    r, J = Points(situation.model, data, W).whitened(situation.values)
    columns = np.concatenate([J, r[..., None]], axis=-1)
    flat = LinearProblem.of_rows(columns, after.mixing).independent[1]
    return flat[:, -1], flat[:, :-1]


def evidence_of(
    situation: Situation,
    data: tuple[Array, Array],
    members: Sequence[Candidate],
    pairs: Sequence[tuple[int, int]],
) -> RivalEvidence:
    """What the data know of the rivals of one place, in a situation that may have more parameters."""
    model = situation.model
    at = [np.setdiff1d(positions(model, c.effect), model.tunings) for c in members]
    # What only a changed situation has is nothing to the data.
    r, rows = data
    rows = np.pad(rows, ((0, 0), (0, len(model.parameters) - rows.shape[1])))
    known, by_known = model.prior_residuals(situation.values)
    r, rows = np.append(r, known), np.concatenate([rows, by_known])
    own = np.concatenate(at)
    # Each rival takes the place of all: to first order, whole refits differ by less than noise.
    y = r + rows[:, own] @ situation.values[own]
    found = RivalEvidence.of(rows, y, model.sizes, at, pairs)
    return replace(found, members=tuple(members))


def doubt_of(situation: Situation, data: tuple[Array, Array], rivalry: Rivalry) -> RivalEvidence:
    """The pairs in doubt; those of a class are by declaration, if either explains anything.

    A cause that stands alone is in doubt where another would often be preferred though it is true; that
    a richer rival would not show beside it is what Schwarz's price means.
    """
    evidence = evidence_of(situation, data, rivalry.members, rivalry.pairs)
    signal = evidence.likeness(evidence.data).size[:, 0]
    open_ = evidence.preferences(evidence.data)[:, 0] < SURE
    pairs = tuple(
        pair
        for pair, doubtful in zip(rivalry.pairs, open_, strict=True)
        if (rivalry.declared or doubtful) and signal[list(pair)].min() > _SOMETHING
    )
    return replace(evidence, pairs=pairs)
