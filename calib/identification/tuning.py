"""Tunings from the data: where a search for one begins, and how sure it is.

The cost of a fit has many minima over cycles, a time constant or a moment, so it is scanned
(:mod:`calib.identification.scan`). The same scan is the profile of the likelihood, from which intervals
follow where it is no parabola.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.arrays import Array, stacked
from calib.effects.tuned import Tuned
from calib.identification.estimators import choose_directions
from calib.identification.scan import Carried, carried, falls, times
from calib.linear import LinearProblem, huber_weights
from calib.model import Model
from calib.observations import Observation, Points, points_of
from calib.poses import Poses
from calib.solver import levenberg_marquardt

_HUBER = 3.0  # median lengths of a pose's residual beyond which it counts less
_ROUNDS, _SETTLED = 8, 0.05
_FINER = 8  # parts into which a step of the grid is divided around the best
_ANY = 1e4  # plausible sizes: amplitudes that nothing holds back
_NOTHING = 1e-8  # share of a column that the rest leaves, below which it is none
_WITHIN = 3.841  # rise of the cost in variances, at the ends of an interval of 95 per cent
_END = 1.96
_WIDE = 12.0  # the same for tunings that are looked at more closely
_AROUND, _PARTS = 6.0, 48  # standard deviations on either side of the estimate, and points there
_PARABOLA = 0.15  # by which the ends of an interval may leave those of the parabola


def with_tunings(points: Points, start: Array) -> tuple[Model, Array]:
    """The model with tunings from the data, and values at which the search begins.

    points : Points, of the model; start : ndarray, shape (p,), SI, base and markers in place
    All else is fitted first; of a pose that stands out only so much counts as others leave, for one
    outlier is no jump. The effects are tuned one after the other, the one that gains most first,
    and each once more beside the others.
    """
    model = points.model
    tuned = [e for e in model.effects if isinstance(e, Tuned)]
    if not tuned:
        return model, start
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
    return _together(model, tuned, chosen, values + span @ step[:k], step[k:])


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


# -- how sure ----------------------------------------------------------------------------------


def profiled(
    observation: Observation, values: Array, span: Array, std: Array, factor: float
) -> Array:
    """Standard deviations of tunings by the profile of the likelihood, NaN where a parabola does, (p,).

    span : ndarray, shape (p, k), directions that were fitted
    std : ndarray, shape (p,), by the parabola
    factor : float, actual over stated noise where whole poses do not err together
    Half the interval of 95 per cent over 1.96, on the wider side.
    """
    model, points = observation.model, points_of(observation)
    out = np.full(len(values), np.nan)
    for effect, part in model.parts:
        fitted = span[part.start].any() or part.start in model.still
        if isinstance(effect, Tuned) and fitted and not effect.rests(values[part]):
            own = _half_width(effect, part, points, values, span, std[part.start], factor)
            out[part.start] = own / _END
    return out


def _half_width(
    effect: Tuned,
    part: slice,
    points: Points,
    values: Array,
    span: Array,
    std: float,
    factor: float,
) -> float:
    """Half the interval, on its wider side; NaN where the parabola's will do."""
    poses, at = points.data.poses, float(values[part.start])
    r, J, (carrier,) = _linearised(points, values, [effect])
    own = times(carrier, effect.functions(poses, np.array(at)))
    others = span[:, ~span[part].any(axis=0)]
    r = r + own @ values[part.start + 1 : part.stop]
    problem = LinearProblem(r, J, others, mixing=points.mixing)
    scan = carried(problem.complement, carrier)
    grid = effect.grid(poses)
    gain = _falls(effect, poses, scan, np.append(grid, at))
    left = float((problem.independent[0] ** 2).sum() - gain[-1])
    spread = left / max(1, int(points.numbers.sum()))
    near = grid[gain[:-1] >= gain[-1] - _WIDE * max(1.0, spread)]
    if effect.smooth:
        near = np.append(near, at + std * np.linspace(-_AROUND, _AROUND, 2 * _PARTS + 1))
    near = np.unique(np.append(near, at))
    cost = -_falls(effect, poses, scan, near)
    limit = _WITHIN * (1.0 if points.mixing is not None else factor**2)
    inside = near[cost <= cost[near == at].min() + limit]
    if effect.smooth:
        half = float(np.abs(inside - at).max())
        return np.nan if abs(half / (_END * std) - 1.0) <= _PARABOLA else half
    read = np.unique(poses.clock)
    before = read[np.searchsorted(read, inside, "right") - 1]
    after = read[np.minimum(np.searchsorted(read, inside, "right"), len(read) - 1)]
    return float(max((at - before).max(), (after - at).max()))
