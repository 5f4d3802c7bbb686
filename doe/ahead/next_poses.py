"""The verb: the poses that tell the rivals of a diagnosis apart, and what to do where no pose can."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.diagnosis import Diagnosis
from calib.errors import CalibError
from calib.poses import Poses
from calib.result import Result
from calib.threads import one_blas_thread
from doe.ahead.evidence import RivalEvidence
from doe.ahead.likeness import SURE
from doe.ahead.objectives import CauseForm, CompoundCriterion, accuracy_of, forms_of, with_accuracy
from doe.ahead.remedies import changes, easiest
from doe.ahead.rivals import (
    data_rows,
    doubt_of,
    evidence_of,
    rivalries,
    situation_after,
    suspicious,
)
from doe.ahead.search import search_of
from doe.ahead.situation import Situation, candidate_rows, likely_read, refusal
from doe.day.day import quickest_order
from doe.plan import named

POSES = 8
"""Poses that are chosen unless the user says otherwise."""
_CANDIDATES = 256
_TRIED = 32  # candidates that an intervention is tried on
_HELPED = 0.05  # rise of the probability from which poses are said to help
_SERVES = 0.5  # of an even share: what a pose must bring to a pair to be said to split it


@dataclass(frozen=True)
class Remedy:
    """An intervention that tells two rivals apart, with the poses best for it."""

    name: str
    says: str
    probability: float


@dataclass(frozen=True)
class PairPrediction:
    """Two rivals, and how likely the true one of them is preferred, whichever it is.

    rivals : two keys ``effect:where``
    now, after : float, with the data in hand, and with the next poses read as well
    remedies : tuple of Remedy, best first, where ``after`` is below ``SURE``
    """

    rivals: tuple[str, str]
    now: float
    after: float
    remedies: tuple[Remedy, ...] = ()

    @property
    def told(self) -> bool:
        """Whether the next poses are enough."""
        return self.after >= SURE

    @property
    def inseparable(self) -> bool:
        """Neither the poses nor any intervention that was tried tells them apart."""
        return not self.told and not self.remedies


@dataclass(frozen=True, eq=False, repr=False)
class NextPoses(Result):
    """Result of :func:`next_poses`.

    poses : Poses, configurations in the order of measuring; none where nothing is in doubt, or where
        no pose helps
    splits : for each pose, the pairs that it helps to tell apart
    predictions : tuple of PairPrediction, of every pair in doubt, the most doubtful first
    assumptions : tuple of str, how the poses are to be read for the predictions to hold
    forms : tuple of PairPrediction, causes that may have another form than their name's
    shares : of what as many poses for the causes alone, and for the accuracy alone, would bring; None
        where the accuracy is not asked for
    """

    poses: Poses
    splits: tuple[tuple[tuple[str, str], ...], ...] = ()
    predictions: tuple[PairPrediction, ...] = ()
    assumptions: tuple[str, ...] = ()
    forms: tuple[PairPrediction, ...] = ()
    shares: tuple[float, float] | None = None

    def sentences(self) -> list[str]:
        if not self.predictions:
            return ["Next poses: no cause is in doubt"]
        return [f"Next poses: {len(self.poses)} that tell causes apart", *self.assumptions]

    def rows(self) -> list[dict[str, object]]:
        return [
            {
                "cause": pair.rivals[0],
                "rival": pair.rivals[1],
                "probability_now": pair.now,
                "probability_after": pair.after,
            }
            for pair in self.predictions
        ]


@one_blas_thread
def next_poses(
    cell: Cell,
    diagnosis: Diagnosis,
    *,
    count: int = POSES,
    seed: int = 0,
    forms: bool = False,
    accuracy: bool = False,
    missed: Poses | None = None,
) -> NextPoses:
    """Poses that best separate what the diagnosis could not tell apart, within the cell's limits.

    count : int, configurations to choose; each is read under every load of the data
    seed : int, of the candidates
    forms : whether poses are to show, too, if a cause that is named has another form than its name's
    accuracy : whether they are to serve the accuracy at the targets beside that
    missed : poses that could not be read: what is nearer to them than to any that was is left out

    The smallest margin of all pairs is maximised by greedy choice and exchange (T-optimality). A pair
    that the whole pool of candidates cannot separate takes no part; for it, and for what is still in
    doubt afterwards, the interventions of :mod:`doe.ahead.remedies` are tried.

    Raises CalibError where count is not positive, or the cell allows no configuration at all.
    """
    if count < 1:
        raise CalibError(f"{count} next poses are too few; ask for at least one")
    nothing = NextPoses(named(np.zeros((0, cell.robot.dof)), "n"))
    if not np.isfinite(diagnosis.after.values).all():
        return nothing
    found = rivalries(diagnosis)
    if suspicious(diagnosis):  # what is there was taken for scatter, which would hide it
        alone = replace(diagnosis.after.observation, scatter=None)
        after = replace(diagnosis.after, levels=None, observation=alone)
        diagnosis = replace(diagnosis, after=after)
    rivals = [c.effect for rivalry in found for c in rivalry.members]
    situation = situation_after(cell, diagnosis, rivals)
    data = data_rows(situation, diagnosis)
    doubts = [doubt for r in found if (doubt := doubt_of(situation, data, r)).pairs]
    unseen = tuple(forms_of(diagnosis, data)) if forms else ()
    if not doubts and not unseen:
        return nothing
    q = situation.feasible(_CANDIDATES, seed)
    q = q[likely_read(cell.robot, q, diagnosis.data.poses, missed)]
    if not len(q):
        raise CalibError(refusal(missed))
    offer = candidate_rows(situation, q, count)
    start = situation.conditions.last
    shown = [form for form in unseen if form.hopeful(offer, start)]
    search = search_of(doubts, offer, start, count, shown)
    if search is not None and accuracy:
        search = with_accuracy(search, accuracy_of(situation, diagnosis, data[1]), count)
    plan = [] if search is None else search.best_plan(count)
    chosen = offer.q[plan]
    # Where no column depends on the approach the order is free: the shortest way.
    if offer.half is None and len(plan):
        chosen = chosen[quickest_order(situation.cell, chosen)]
    judged = [pair for doubt in doubts for pair in _judged(doubt, situation, chosen)]
    told = {prediction.rivals for prediction, _ in judged if prediction.told}
    remedies = _remedies(doubts, told, situation, data, q[:_TRIED], count)
    predictions = [replace(p, remedies=remedies.get(p.rivals, ())) for p, _ in judged]
    splits = tuple(tuple(p.rivals for p, serves in judged if serves[i]) for i in range(len(chosen)))
    shares = None
    if search is not None and isinstance(search.weigh, CompoundCriterion):
        first, second = search.weigh.of(search.values(plan))
        shares = float(first), float(second)
    return NextPoses(
        named(chosen, "n"),
        splits,
        tuple(sorted(predictions, key=lambda p: p.now)),
        assumptions_of(situation, len(chosen)),
        tuple(_shown(form, situation, chosen) for form in unseen),
        shares,
    )


def _shown(form: CauseForm, situation: Situation, q: Array) -> PairPrediction:
    """How surely another form of a cause would be seen, now and with the poses read."""
    names = form.key, f"another form of {form.key}"
    now = float(form.power(form.data.S))
    if not len(q):
        return PairPrediction(names, now, now)
    whole = form.data.added(form.blocks(situation.in_order(q), q))
    return PairPrediction(names, now, float(form.power(whole.S)))


def _judged(
    evidence: RivalEvidence, situation: Situation, q: Array
) -> list[tuple[PairPrediction, list[bool]]]:
    """Every pair before and after, and which poses it owes that to; the sequence as it is read."""
    data = evidence.data
    now = evidence.probabilities(data)
    if not len(q):
        return [
            (PairPrediction(k, float(p), float(p)), [])
            for k, p in zip(evidence.keys, now, strict=True)
        ]
    blocks = evidence.blocks(situation.in_order(q))
    whole = data.added(blocks)
    after, reached = evidence.probabilities(whole), evidence.separation(whole)
    gained = reached - evidence.separation(data)
    lost = [
        reached - evidence.separation(data.added(np.delete(blocks, i, axis=0)))
        for i in range(len(q))
    ]
    serves = (np.array(lost) >= _SERVES * gained / len(q)) & (gained > 0.0)
    helped = (after >= SURE) | (after > now + _HELPED)
    return [
        (
            PairPrediction(key, float(now[i]), float(after[i])),
            [bool(helped[i] and row[i].any()) for row in serves],
        )
        for i, key in enumerate(evidence.keys)
    ]


def _remedies(
    doubts: Sequence[RivalEvidence],
    told: Collection[tuple[str, str]],
    situation: Situation,
    data: tuple[Array, Array],
    q: Array,
    count: int,
) -> dict[tuple[str, str], tuple[Remedy, ...]]:
    """Interventions that tell apart what poses cannot, each with the poses best for it.

    told : keys of the pairs that poses do tell apart
    """
    found: dict[tuple[str, str], list[Remedy]] = {}
    open_ = [own for doubt in doubts if (own := doubt.without(told)).pairs]
    for change in changes(situation) if open_ else ():
        changed = change.situation
        allowed = changed.allowed(q)
        if not len(allowed):
            continue
        offer = candidate_rows(changed, allowed, count)
        for doubt in open_:
            evidence = evidence_of(changed, data, doubt.members, doubt.pairs)
            search = search_of([evidence], offer, changed.conditions.last, count)
            if search is None:
                continue
            plan = search.greedy(count)
            after = evidence.probabilities(search.known(plan)[0])
            if after.max() >= SURE:  # worth a second look, as it is read
                blocks = evidence.blocks(changed.in_order(offer.q[plan]))
                after = evidence.probabilities(evidence.data.added(blocks))
            for key, probability in zip(doubt.keys, after.tolist(), strict=True):
                if probability >= SURE:
                    found.setdefault(key, []).append(Remedy(change.name, change.says, probability))
    # The surest few, one of a kind, the easier one first where they are equal.
    ordered = {
        key: sorted(own, key=lambda remedy: -round(remedy.probability, 2))
        for key, own in found.items()
    }
    return {key: easiest(own, lambda remedy: remedy.name) for key, own in ordered.items()}


def assumptions_of(situation: Situation, count: int) -> tuple[str, ...]:
    """How the poses to come are taken to be read."""
    if not count:
        return ()
    conditions = situation.conditions
    loads = len(conditions.loads)
    said = [
        "one reading a pose" if loads == 1 else f"each pose under all {loads} loads of the data"
    ]
    said.append("in the order given, from where the data end; the approach follows from the order")
    if conditions.time is not None:
        said.append(f"one reading every {conditions.pace:.0f} s from the last reading on")
    if conditions.temperature is not None:
        said.append(f"at the last temperature, {conditions.temperature:.1f} degC")
    return tuple(said)
