"""Tunings from the data: where a search for one begins.

The cost of a fit has many minima over cycles, a time constant or a moment, so it is scanned
(:mod:`calib.identification.scan`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.arrays import Array, stacked
from calib.effects.tuned import Tuned
from calib.identification.estimators import choose_directions
from calib.identification.fit import strayed
from calib.identification.scan import Carried, carried, falls, times
from calib.linear import LinearProblem, huber_weights
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
    outlier is no jump. The effects are tuned one after the other, the one that gains most first,
    and each once more beside the others. What diverges begins where it was.
    """
    model = points.model
    tuned = [e for e in model.effects if isinstance(e, Tuned)]
    if not tuned:
        return points, start
    rest, known = points.model.without(tuned, start)
    values, span, share = _fitted(replace(points, model=rest), known)
    r, J, carriers = _linearised(replace(points, model=rest), values, tuned)
    problem = LinearProblem(share[:, None] * r, J, span, mixing=points.mixing)
    found = dict[int, Tuned]()

    def columns(i: int) -> Array:
        functions = found[i].functions(points.data.poses, np.array(found[i].tuning))
        return times(carriers[i], functions)

    def scanned(i: int) -> tuple[float, float]:
        others = [columns(j) for j in found if j != i]
        beside = problem.complement
        if others:
            beside = beside.without(beside.columns(np.concatenate(others, axis=-1)))
        return _best(tuned[i], points.data.poses, carried(beside, carriers[i]))

    alone = [scanned(i) for i in range(len(tuned))]
    first, *others = sorted(range(len(tuned)), key=lambda i: -alone[i][1])
    found[first] = tuned[first].tuned(alone[first][0])
    for i in (*others, first, *others) if others else ():
        found[i] = tuned[i].tuned(scanned(i)[0])
    X = stacked(np.concatenate([J @ span, *map(columns, range(len(tuned)))], axis=-1))
    size = np.linalg.norm(X, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    step = np.linalg.lstsq(X / size, problem.r.ravel(), rcond=_NOTHING)[0] / size
    chosen, k = [found[i] for i in range(len(tuned))], span.shape[1]
    model, begun = _together(model, tuned, chosen, values + span @ step[:k], step[k:])
    away = strayed(model, points.data, start, begun)
    return replace(points, model=model), np.where(away, start, begun)


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


def _best(effect: Tuned, poses: Poses, carried: Carried) -> tuple[float, float]:
    """The tuning that lowers the cost most, and by how much."""
    grid = effect.grid(poses)
    if not len(grid):
        return effect.tuning, 0.0
    gain = _falls(effect, poses, carried, grid)
    best = int(gain.argmax())
    if effect.smooth and len(grid) > 1:
        ends = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
        grid = np.append(grid[best], np.linspace(*ends, 2 * _FINER + 1))
        gain = _falls(effect, poses, carried, grid)
        best = int(gain.argmax())
    return float(grid[best]), float(gain[best])


def _falls(effect: Tuned, poses: Poses, carried: Carried, tunings: Array) -> Array:
    """By how much the cost falls with the effect at each tuning (C,), whatever its amplitudes, (C,)."""
    f = effect.functions(poses, tunings).shape[-1]
    sizes = np.array([p.size for p in effect.amplitudes]).reshape(f, -1)
    return falls(carried, effect.functions(poses, tunings), _ANY * sizes.ravel())
