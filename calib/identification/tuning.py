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
from calib.identification.estimators import choose_directions
from calib.identification.fit import diverged
from calib.identification.scan import carried, falls, times
from calib.linear import LinearProblem, huber_weights, unit
from calib.model import Model
from calib.observations import Points
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
    tuned = [e for e in points.model.effects if isinstance(e, Tuned)]
    if not tuned:
        return points, start
    rest, known = points.model.without(tuned, start)
    values, span, share = _fitted(replace(points, model=rest), known)
    r, J, carriers = _linearised(replace(points, model=rest), values, tuned)
    problem = LinearProblem(share[:, None] * r, J, span)
    scans = [_Scan(*own, points.data.poses, problem) for own in zip(tuned, carriers, strict=True)]
    found = _one_after_the_other(scans)
    step = _step(problem, [scan.columns(e) for scan, e in zip(scans, found, strict=True)])
    k = span.shape[1]
    model, first = _together(points.model, tuned, found, values + span @ step[:k], step[k:])
    away = diverged(model, points.data, start, first)
    return replace(points, model=model), np.where(away, start, first)


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

    def best(self, others: Sequence[Array]) -> tuple[float, float]:
        """The tuning that lowers the cost most beside the columns of others, and by how much."""
        grid, beside = self.effect.grid(self.poses), self.problem.complement
        if not len(grid):
            return self.effect.tuning, 0.0
        if others:
            beside = beside.without(beside.columns(np.concatenate(others, axis=-1)))
        products = carried(beside, self.carrier)

        def gains(tunings: Array) -> Array:
            functions = self.effect.functions(self.poses, tunings)
            sizes = np.array([p.size for p in self.effect.amplitudes])
            return falls(products, functions, _ANY * sizes)

        gain = gains(grid)
        best = int(gain.argmax())
        if self.effect.smooth and len(grid) > 1:
            ends = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
            grid = np.append(grid[best], np.linspace(*ends, 2 * _FINER + 1))
            gain = gains(grid)
            best = int(gain.argmax())
        return float(grid[best]), float(gain[best])


def _one_after_the_other(scans: Sequence[_Scan]) -> list[Tuned]:
    """The effects tuned, the one that gains most first, and each once more beside the others."""
    found: dict[int, Tuned] = {}

    def tuned(i: int) -> Tuned:
        others = [scans[j].columns(e) for j, e in found.items() if j != i]
        return scans[i].effect.tuned(scans[i].best(others)[0])

    alone = [scan.best(()) for scan in scans]
    first, *others = sorted(range(len(scans)), key=lambda i: -alone[i][1])
    found[first] = scans[first].effect.tuned(alone[first][0])
    for i in (*others, first, *others) if others else ():
        found[i] = tuned(i)
    return [found[i] for i in range(len(scans))]


def _step(problem: LinearProblem, columns: Sequence[Array]) -> Array:
    """Least-squares change (k + n,) of the k directions of a problem and of n amplitudes."""
    X = stacked(np.concatenate([problem.J @ problem.span, *columns], axis=-1))
    size = np.linalg.norm(X, axis=0)
    found = np.linalg.lstsq(unit(X), problem.r.ravel(), rcond=_NOTHING)[0]
    return np.asarray(found / np.where(size > 0.0, size, 1.0))


def _fitted(points: Points, start: Array) -> tuple[Array, Array, Array]:
    """Values and span of the rest of the model, and the share of its residual each pose keeps, (m,)."""
    span = points.span()[:, choose_directions(points, start).kept]
    measured = points.counted.any(axis=1)
    values, share = start, np.ones(len(points.data))
    for _ in range(_ROUNDS):
        weighted = replace(points, weights=points.weights * share[:, None, None, None])
        values = levenberg_marquardt(weighted.flat, values, span).values
        length = np.linalg.norm(points.whitened(values)[0], axis=-1)
        before, share = share, huber_weights(length, float(np.median(length[measured])), _HUBER)
        if np.allclose(share, before, atol=_SETTLED):
            break
    return values, span, share


def _linearised(
    points: Points, values: Array, tuned: Sequence[Tuned]
) -> tuple[Array, Array, list[Array]]:
    """Residuals (m, rows), derivatives (m, rows, p), and the rows (m, rows, b) of each carrier."""
    carriers = [effect.carrier for effect in tuned]
    whole, extended = points.model.extended(values, carriers)
    r, J = replace(points, model=whole).whitened(extended)
    first = len(whole.effects) - len(carriers)
    return r, J[..., : len(values)], [J[..., part] for part in whole.slices[first:]]


def _together(
    model: Model, old: Sequence[Tuned], new: Sequence[Tuned], rest: Array, amplitudes: Array
) -> tuple[Model, Array]:
    """The model with the new in place of the old, and its values."""
    by_old = {id(before): after for before, after in zip(old, new, strict=True)}
    model = model.with_effects(tuple(by_old.get(id(e), e) for e in model.effects))
    values, own = model.initial, model.where(Tuned)
    values[np.setdiff1d(np.arange(len(values)), own)] = rest
    values[np.setdiff1d(own, model.tunings)] = amplitudes
    return model, values
