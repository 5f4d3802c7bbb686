"""Tunings from the data: where a search for one begins.

The cost of a fit has many minima over cycles, a time constant or a moment, so it is scanned
(:mod:`calib.identification.scan`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, stacked
from calib.effects.tuned import Tuned
from calib.identification.fit import choose_directions
from calib.identification.scan import carried, falls, times
from calib.identification.start import diverged
from calib.observations import Points
from calib.observations.linear import LinearProblem, unit
from calib.poses import Poses
from calib.solver import levenberg_marquardt

_HUBER = 3.0  # median lengths of a pose's residual beyond which it counts less
_ROUNDS, _SETTLED = 8, 0.05
_FINER = 8  # parts into which a step of the grid is divided around the best
_ANY = 1e4  # plausible sizes: amplitudes that nothing holds back
_NOTHING = 1e-8  # share of a column that the rest leaves, below which it is none


def with_tunings(points: Points, start: Array) -> tuple[Points, Array]:
    """The readings of the model with tunings from the data, and values at which the search begins.

    points : Points, of the model; start : ndarray, shape (p,), SI, base and markers in place
    All else is fitted first; of a pose that stands out only so much counts as others leave, for one
    outlier is no jump. What diverges begins where it was.
    """
    model = points.model
    old = [e for e in model.effects if isinstance(e, Tuned)]
    if not old:
        return points, start
    model_of_rest, at_rest = model.without(old, start)
    rest, span, share = _fitted(replace(points, model=model_of_rest), at_rest)
    scans = _scans(replace(points, model=model_of_rest), rest, span, share, old)
    new = _one_after_the_other(scans)
    # The change of the directions, and the amplitudes, by least squares.
    problem = scans[0].problem
    columns = [scan.columns(effect) for scan, effect in zip(scans, new, strict=True)]
    X = stacked(np.concatenate([problem.J @ span, *columns], axis=-1))
    size = np.linalg.norm(X, axis=0)
    step = np.linalg.lstsq(unit(X), problem.r.ravel(), rcond=_NOTHING)[0]
    step = step / np.where(size > 0.0, size, 1.0)
    by_old = {id(before): after for before, after in zip(old, new, strict=True)}
    model = model.with_effects(tuple(by_old.get(id(e), e) for e in model.effects))
    values, at = model.initial, model.where(Tuned)
    values[np.setdiff1d(np.arange(len(values)), at)] = rest + span @ step[: span.shape[1]]
    values[np.setdiff1d(at, model.tunings)] = step[span.shape[1] :]
    away = diverged(model, points.data, start, values)
    return replace(points, model=model), np.where(away, start, values)


def _fitted(points: Points, start: Array) -> tuple[Array, Array, Array]:
    """Values and span of the rest of the model, and the share of its residual each pose keeps, (m,)."""
    span = points.span()[:, choose_directions(points, start).kept]
    measured = points.counted.any(axis=1)
    values, share = start, np.ones(len(points.data))
    for _ in range(_ROUNDS):
        weighted = replace(points, weights=points.weights * share[:, None, None, None])
        values = levenberg_marquardt(weighted.flat, values, span).values
        length = np.linalg.norm(points.whitened(values)[0], axis=-1)
        most = _HUBER * float(np.median(length[measured]))
        before, share = share, np.minimum(1.0, most / np.maximum(length, 1e-12))
        if np.allclose(share, before, atol=_SETTLED):
            break
    return values, span, share


@dataclass(frozen=True, eq=False)
class _Scan:
    """One effect that is tuned: whitened rows (m, R, b) of its carrier, and the problem beside it."""

    effect: Tuned
    carrier: Array
    poses: Poses
    problem: LinearProblem

    def columns(self, tuned: Tuned) -> Array:
        """Whitened rows of the effect once it is tuned, shape (m, R, f b)."""
        return times(self.carrier, tuned.functions(self.poses, np.array(tuned.tuning)))

    def best(self, others: Sequence[Array] = ()) -> tuple[float, float]:
        """The tuning that lowers the cost most beside the columns of others, and by how much."""
        grid, beside = self.effect.grid(self.poses), self.problem.complement
        if not len(grid):
            return self.effect.tuning, 0.0
        if others:
            beside = beside.without(beside.columns(np.concatenate(others, axis=-1)))
        products = carried(beside, self.carrier)
        limits = _ANY * np.array([p.size for p in self.effect.amplitudes])

        def gains(tunings: Array) -> Array:
            return falls(products, self.effect.functions(self.poses, tunings), limits)

        gain = gains(grid)
        best = int(gain.argmax())
        if self.effect.smooth and len(grid) > 1:
            ends = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
            grid = np.append(grid[best], np.linspace(*ends, 2 * _FINER + 1))
            gain = gains(grid)
            best = int(gain.argmax())
        return float(grid[best]), float(gain[best])


def _scans(
    points: Points, values: Array, span: Array, share: Array, tuned: Sequence[Tuned]
) -> list[_Scan]:
    """A scan of each effect beside the rest of the model, of which each pose keeps a share (m,)."""
    carriers = [effect.carrier for effect in tuned]
    whole, extended = points.model.extended(values, carriers)
    r, J = replace(points, model=whole).whitened(extended)
    problem = LinearProblem(share[:, None] * r, J[..., : len(values)], span)
    parts = whole.slices[len(whole.effects) - len(carriers) :]
    return [
        _Scan(effect, J[..., part], points.data.poses, problem)
        for effect, part in zip(tuned, parts, strict=True)
    ]


def _one_after_the_other(scans: Sequence[_Scan]) -> list[Tuned]:
    """The effects tuned, the one that gains most first, and each once more beside the others."""
    alone = [scan.best() for scan in scans]
    first, *others = sorted(range(len(scans)), key=lambda i: -alone[i][1])
    tuned = {first: scans[first].effect.tuned(alone[first][0])}
    for i in (*others, first, *others) if others else ():
        beside = [scans[j].columns(e) for j, e in tuned.items() if j != i]
        tuned[i] = scans[i].effect.tuned(scans[i].best(beside)[0])
    return [tuned[i] for i in range(len(scans))]
