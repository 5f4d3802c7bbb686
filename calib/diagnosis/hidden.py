"""What readings could not have shown: how large it may be, and what it would do at the targets."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.contest import Outcome
from calib.diagnosis.linear import linearised
from calib.diagnosis.power import detectable
from calib.diagnosis.rounds import ALPHA
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Parameter
from calib.model.covariance import working_points
from calib.poses import Poses

_NEVER = 1e3  # plausible sizes: what must be larger to be found is not visible


@dataclass(frozen=True)
class Hidden:
    """The size (SI) that an effect must have to be found; infinite where no size would do.

    left : float, m, 3-D RMS that it leaves per point where accuracy counts, at that size or at a
        plausible one where that is less, once the model has taken up what it can of it
    """

    effect: str
    where: str
    smallest: float
    unit: str
    scale: float
    left: float


@dataclass(frozen=True, eq=False)
class _Error:
    """One parameter at one size: derivatives (N,) of all independent rows."""

    candidate: Candidate
    number: int
    parameter: Parameter
    smallest: float
    rows: Array

    @property
    def size(self) -> float:
        return min(self.smallest, self.parameter.size)


def hidden(
    stage: Stage,
    outcome: Outcome,
    entered: Collection[str],
    targets: tuple[Poses, Array],
) -> tuple[Hidden, ...]:
    """What every cause that is not in would have to be to be found, nine times in ten.

    entered : keys of those that are
    targets : Poses, and weights (t,); an effect that depends on more than joints and load, such as
        drift, is judged at the readings instead
    """
    errors = [
        _error(outcome, candidate)
        for candidate in outcome.suspects
        if candidate.named and not candidate.echo and candidate.key not in entered
    ]
    fit = outcome.view.fit
    by_joints = [e for e in errors if not e.candidate.effect.uses]
    others = [e for e in errors if e.candidate.effect.uses]
    poses = stage.data.poses
    left = {
        **_left(fit, by_joints, *targets),
        **_left(fit, others, poses, np.where(stage.dropped, 0.0, 1.0)),
    }
    return tuple(
        Hidden(
            e.candidate.effect.kind,
            e.candidate.effect.where,
            e.smallest,
            e.parameter.unit,
            e.parameter.scale,
            left[e.candidate.key],
        )
        for e in errors
    )


def _error(outcome: Outcome, candidate: Candidate) -> _Error:
    """The parameter of a cause that is found best, against the size of such errors."""
    columns, parameters = outcome.view.where[candidate.key], candidate.amounts
    asked = len(outcome.suspects) * candidate.tried
    sizes = detectable(outcome.last, columns, asked, ALPHA).smallest.tolist()
    number = min(range(len(sizes)), key=lambda k: sizes[k] / parameters[k].size)
    size, parameter = sizes[number], parameters[number]
    size = size if size < _NEVER * parameter.size else np.inf
    rows = outcome.last.columns[:, columns[number]]
    return _Error(candidate, number, parameter, size, rows)


def _left(fit: Fit, errors: Sequence[_Error], poses: Poses, weights: Array) -> dict[str, float]:
    """RMS (m) that each leaves at poses: ``X_t s - J_t (J^+ X s)``, by the candidate's key."""
    if not errors:
        return {}
    _, J = fit.equations
    X = np.stack([e.rows * e.size for e in errors], axis=1)
    taken = fit.span @ np.linalg.lstsq(J @ fit.span, X, rcond=None)[0]
    model = working_points(fit.model)
    there = linearised(model, fit.values, poses, [e.candidate.effect for e in errors])
    own = np.concatenate([there.of(effect) for effect in there.effects], axis=-1)
    moved = np.stack([_column(there.of(e.candidate.effect), e) for e in errors], axis=-1)
    squares = ((moved - own @ taken) ** 2).sum(axis=2).mean(axis=1)
    rms = np.sqrt(weights @ squares / weights.sum())
    return dict(zip((e.candidate.key for e in errors), rms.tolist(), strict=True))


def _column(columns: Array, error: _Error) -> Array:
    """Displacements (t, C, 3), m, by an effect's parameters (t, C, 3, k) at the error's size."""
    first = columns.shape[-1] - len(error.candidate.amounts)  # a tuning is no size
    return np.asarray(columns[..., first + error.number] * error.size)
