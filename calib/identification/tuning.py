"""Tunings from the data: where a search for one begins, and how sure it is.

The cost of a fit has many minima over cycles, a time constant or a moment, so it is scanned: at the fit
of all else, an effect with tuning c gains ``s^T S^-1 s``, s the inner products of its columns with what
is left and S those of its columns among themselves, both less their part in the span of the rest. The
columns of a pose are functions times the carrier's rows, so that all tunings come from a few matrix
products. The same gain is the profile of the likelihood, from which intervals follow where it is no
parabola.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.arrays import Array, stacked
from calib.effects.tuned import Tuned
from calib.identification.estimators import choose_directions
from calib.model import Model
from calib.observations import Observation, Points, points_of
from calib.poses import Poses
from calib.solver import levenberg_marquardt

_HUBER = 3.0  # median lengths of a pose's residual beyond which it counts less
_ROUNDS, _SETTLED = 8, 0.05
_FINER = 8  # parts into which a step of the grid is divided around the best
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
    r, J, carried = _linearised(replace(points, model=rest), values, tuned)
    r = share[:, None] * r
    X, poses = J @ span, points.data.poses
    Q, found = _basis([X]), dict[int, Tuned]()
    alone = [_scanned(e, poses, c, r, Q) for e, c in zip(tuned, carried, strict=True)]
    first, *others = sorted(range(len(tuned)), key=lambda i: -alone[i][1])
    found[first] = tuned[first].tuned(alone[first][0])
    for i in (*others, first, *others) if others else ():
        beside = [_columns(e, poses, carried[j], e.tuning) for j, e in found.items() if j != i]
        found[i] = tuned[i].tuned(_scanned(tuned[i], poses, carried[i], r, _basis([X, *beside]))[0])
    chosen = [found[i] for i in range(len(tuned))]
    own = [_columns(e, poses, c, e.tuning) for e, c in zip(chosen, carried, strict=True)]
    step = _solved([X, *own], r)
    k = span.shape[1]
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
        before, typical = share, _HUBER * float(np.median(length[measured]))
        share = np.minimum(1.0, typical / np.maximum(length, 1e-12))
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
    values, first, begin = model.initial, 0, 0
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Tuned):
            count = len(effect.amplitudes)
            values[part.start + 1 : part.stop] = amplitudes[begin : begin + count]
            begin += count
        else:
            count = part.stop - part.start
            values[part] = rest[first : first + count]
            first += count
    return model, values


def _scanned(
    effect: Tuned, poses: Poses, carried: Array, r: Array, Q: Array
) -> tuple[float, float]:
    """The tuning that gains most beside what Q spans, and its gain."""
    grid = effect.grid(poses)
    if not len(grid):
        return effect.tuning, 0.0
    gain = gains(effect, poses, carried, r, Q, grid)
    best = int(gain.argmax())
    if effect.smooth and len(grid) > 1:
        ends = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
        grid = np.append(grid[best], np.linspace(*ends, 2 * _FINER + 1))
        gain = gains(effect, poses, carried, r, Q, grid)
        best = int(gain.argmax())
    return float(grid[best]), float(gain[best])


def gains(effect: Tuned, poses: Poses, carried: Array, r: Array, Q: Array, tunings: Array) -> Array:
    """By how much the cost falls with the effect at each tuning (C,) beside what Q spans, (C,).

    carried : ndarray, shape (m, R, b), rows of its carrier; r : ndarray, shape (m, R), residuals
    Q : ndarray, shape (m R, k), orthonormal columns
    """
    m, R, b = carried.shape
    flat = r.ravel()
    left = (flat - Q @ (Q.T @ flat)).reshape(m, R)
    F = np.swapaxes(effect.functions(poses, tunings), -1, -2)  # (C, f, m)
    C, f = F.shape[:2]
    s = (F @ np.einsum("mrb,mr->mb", carried, left)).reshape(C, f * b)
    pairs = (F[:, :, None] * F[:, None]).reshape(C, f * f, m)
    among = (pairs @ np.einsum("mrb,mrc->mbc", carried, carried).reshape(m, b * b)).reshape(
        C, f, f, b, b
    )
    Z = among.transpose(0, 1, 3, 2, 4).reshape(C, f * b, f * b)
    shared = np.swapaxes(carried, -1, -2) @ Q.reshape(m, R, -1)  # (m, b, k)
    onto = (F @ shared.reshape(m, -1)).reshape(C, f * b, -1)
    size = np.sqrt(np.diagonal(Z, axis1=-2, axis2=-1))
    scale = np.where(size > 0.0, size, 1.0)
    S = (Z - onto @ np.swapaxes(onto, -1, -2)) / (scale[:, :, None] * scale[:, None, :])
    values, vectors = np.linalg.eigh(S)
    along = (np.swapaxes(vectors, -1, -2) @ (s / scale)[..., None])[..., 0]
    seen = values > _NOTHING
    return np.asarray((seen * along**2 / np.where(seen, values, 1.0)).sum(axis=-1))


def _columns(effect: Tuned, poses: Poses, carried: Array, tuning: float) -> Array:
    """Columns of the amplitudes at a tuning, shape (m, R, f b)."""
    F = effect.functions(poses, np.array(tuning))
    both = F[:, None, :, None] * carried[:, :, None, :]
    return both.reshape(*carried.shape[:2], -1)


def _flat(blocks: Sequence[Array]) -> Array:
    return np.concatenate([stacked(b) for b in blocks], axis=1)


def _basis(blocks: Sequence[Array]) -> Array:
    """Orthonormal basis of the span of columns (m, R, k) side by side."""
    X = _flat(blocks)
    size = np.linalg.norm(X, axis=0)
    U, s, _ = np.linalg.svd(X / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return np.asarray(U[:, s > _NOTHING * s.max(initial=0.0)])


def _solved(blocks: Sequence[Array], r: Array) -> Array:
    """Least squares of residuals (m, R) by columns side by side."""
    X = _flat(blocks)
    size = np.linalg.norm(X, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return np.asarray(np.linalg.lstsq(X / size, r.ravel(), rcond=_NOTHING)[0] / size)


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
    for effect, part in zip(model.effects, model.slices, strict=True):
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
    r, J, (carried,) = _linearised(points, values, [effect])
    others = J @ span[:, ~span[part].any(axis=0)]
    r = r + (_columns(effect, poses, carried, at) @ values[part.start + 1 : part.stop])
    grid = effect.grid(poses)
    gain = gains(effect, poses, carried, r, _basis([others]), np.append(grid, at))
    spread = float((r**2).sum() - gain[-1]) / max(1, int(points.numbers.sum()))
    near = grid[gain[:-1] >= gain[-1] - _WIDE * max(1.0, spread)]
    if effect.smooth:
        near = np.append(near, at + std * np.linspace(-_AROUND, _AROUND, 2 * _PARTS + 1))
    near = np.unique(np.append(near, at))
    cost = _costs(effect, points, carried, r, others, near)
    limit = _WITHIN * (1.0 if points.mixing is not None else factor**2)
    inside = near[cost <= cost[near == at].min() + limit]
    if effect.smooth:
        half = float(np.abs(inside - at).max())
        return np.nan if abs(half / (_END * std) - 1.0) <= _PARABOLA else half
    read = np.unique(poses.clock)
    before = read[np.searchsorted(read, inside, "right") - 1]
    after = read[np.minimum(np.searchsorted(read, inside, "right"), len(read) - 1)]
    return float(max((at - before).max(), (after - at).max()))


def _costs(
    effect: Tuned, points: Points, carried: Array, r: Array, others: Array, tunings: Array
) -> Array:
    """Cost of the fit beside the others at each tuning (C,), in variances of independent rows, (C,)."""
    mixing, poses = points.mixing, points.data.poses
    columns = [_columns(effect, poses, carried, float(c)) for c in tunings]
    if mixing is not None:
        r, others = mixing(r[..., None])[..., 0], mixing(others)
        columns = [mixing(own) for own in columns]
    Q, flat = _basis([others]), r.ravel()
    left = flat - Q @ (Q.T @ flat)
    found = []
    for own in columns:
        Z = _flat([own])
        Z = Z - Q @ (Q.T @ Z)
        rest = left - Z @ np.linalg.lstsq(Z, left, rcond=_NOTHING)[0]
        found.append(float(rest @ rest))
    return np.array(found)
