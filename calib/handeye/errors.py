"""By how much hand-eye calibrations miss images that they were without."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal, Self, TypeAlias

import numpy as np

from calib.arm.se3 import (
    displacement,
    inverse,
    moved_as_one,
    nearest_rotation,
    rotate,
    so3_log,
    transform,
    transformed,
)
from calib.arrays import Array, IntArray, Mask
from calib.handeye.samples import Pair, turn_between
from calib.instruments import Camera, Pose
from calib.model import Model
from calib.poses import Measurements
from calib.solver import levenberg_marquardt
from calib.uncertainty.expanded import LEVEL, Interval

Unit: TypeAlias = Literal["px", "mm", "mrad"]
UNITS: dict[Unit, float] = {"px": 1.0, "mm": 1e-3, "mrad": 1e-3}
"""Of what is missed, and their sizes in SI."""


@dataclass(frozen=True, eq=False)
class Missed:
    """What a calibration misses m images by, and which these are.

    group : ndarray of int, shape (m,), configurations of the arm
    px : ndarray, shape (m,), summed squares of the distances of points; points : their number; zero
        where poses are read
    mm, mrad : ndarray, shape (m,), m and rad, of the target's place and turn as the image shows them,
        NaN where it does not
    loss : ndarray, shape (m,), squares of all numbers that are read, in standard deviations as stated
    """

    group: IntArray
    px: Array
    points: Array
    mm: Array
    mrad: Array
    loss: Array

    @classmethod
    def together(cls, parts: Sequence[Missed]) -> Self:
        """Of the images of several."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))

    def only(self, chosen: Mask) -> Self:
        """Of some of the images."""
        return replace(self, **{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    @property
    def none(self) -> Self:
        """Of no image."""
        return self.only(np.zeros(len(self.group), dtype=bool))

    def rms(self, unit: Unit) -> Interval | None:
        """Root mean square with what it is at other poses like these; None where none is read.

        Configurations count, not images or points: what one errs by is common to all that it reads.
        The logarithm of their mean square is taken as Student's t of as many.
        """
        from scipy.special import stdtrit

        squares, weights = getattr(self, unit), np.ones(len(self.group))
        if unit == "px":
            weights = self.points
        else:
            squares = squares**2
        there = np.isfinite(squares) & (weights > 0)
        if not there.any():
            return None
        own = _by_group(self.group[there], squares[there], weights[there])
        mean = own[0].sum() / own[1].sum()
        count = len(own[0])
        half = np.inf
        if count > 1 and mean > 0.0:
            off = (own[0] - mean * own[1]) / own[1].mean()
            spread = np.sqrt((off**2).sum() / (count - 1) / count) / mean
            half = float(stdtrit(count - 1, 0.5 + LEVEL / 2.0)) * spread / 2.0
        value = float(np.sqrt(mean)) / UNITS[unit]
        return Interval(value, value * float(np.exp(-half)), value * float(np.exp(half)))


def _by_group(group: IntArray, *values: Array) -> tuple[Array, ...]:
    """Sums of values (m,) over the configurations, shape (k,) each."""
    which = np.unique(group, return_inverse=True)[1].reshape(-1)
    return tuple(np.bincount(which, own).astype(float) for own in values)


def lower(first: Missed, second: Missed) -> float | None:
    """Probability by chance that the first misses as much less than the second; None of too few.

    The signed-rank test of Wilcoxon over configurations, so that a bad image counts once.
    """
    from scipy.stats import wilcoxon

    shared = np.intersect1d(first.group, second.group)
    off = np.zeros(len(shared))
    for own, sign in ((first, 1.0), (second, -1.0)):
        here = np.isin(own.group, shared)
        off += sign * _by_group(own.group[here], own.loss[here])[0]
    if len(off) < _FEWEST or not off.any():
        return None
    return float(wilcoxon(off, alternative="less").pvalue)


_TOLD = 100  # degrees of freedom: of fewer, images do not say how good they are
_FEWEST = 6  # configurations: of fewer, all alike are chance


def missed_by_model(
    pair: Pair, model: Model, values: Array, data: Measurements, group: IntArray, C: Array
) -> Missed:
    """What a model misses; C : ndarray, shape (m, 4, 4), as the images show it, NaN where not."""
    off = model.off(values, data)[:, pair.part]
    return _missed(pair, pair.predicted(model, values, data.poses), C, off, data, group)


def missed_by(
    pair: Pair, carried: Array, E: Array, W: Array, data: Measurements, group: IntArray, C: Array
) -> Missed:
    """What a camera at E misses with its target at W, both (4, 4); carried : F, shape (m, 4, 4)."""
    predicted = inverse(carried @ E) @ W
    off = data.readings[:, pair.part].copy()
    if isinstance(pair.instrument, Camera):
        shown = transformed(predicted[:, None], pair.points)
        off[..., :2] -= pair.instrument.lens.project(shown)
    return _missed(pair, predicted, C, off * data.seen[:, pair.part, None], data, group)


def _missed(
    pair: Pair, predicted: Array, C: Array, off: Array, data: Measurements, group: IntArray
) -> Missed:
    seen = data.seen[:, pair.part]
    count = len(seen)
    px, points, loss = np.zeros(count), np.zeros(count), np.zeros(count)
    shift, turn = (np.full(count, np.nan) for _ in range(2))
    there = np.asarray(np.isfinite(C).all(axis=(1, 2)))
    turn[there] = turn_between(predicted[there, :3, :3], C[there, :3, :3])
    if isinstance(pair.instrument, Pose):
        read = (inverse(C), inverse(predicted)) if pair.eye == "in-hand" else (C, predicted)
        back = np.swapaxes(read[1][:, :3, :3], -1, -2)
        moved = rotate(back, read[0][:, :3, 3] - read[1][:, :3, 3])
        shift = np.linalg.norm(moved, axis=-1)
        spun = so3_log(np.where(there[:, None, None], back @ read[0][:, :3, :3], np.eye(3)))
        error = np.concatenate([moved, spun], axis=-1)
        half = np.linalg.inv(np.linalg.cholesky(pair.instrument.covariance))
        loss = np.where(there, (rotate(half, error) ** 2).sum(axis=-1), 0.0)
    else:
        middle = pair.points.mean(axis=0)
        both = (transformed(T[there], middle) for T in (predicted, C))
        first, second = both
        shift[there] = np.linalg.norm(first - second, axis=-1)
        px, points = (off[..., :2] ** 2).sum(axis=(1, 2)), seen.sum(axis=1).astype(float)
        loss = px / pair.instrument.sigma**2
    here = np.asarray(seen.any(axis=1))
    every = Missed(group, px, points, shift, turn, loss)
    return every.only(here)


def target_of(
    pair: Pair, carried: Array, E: Array, data: Measurements, C: Array, there: Mask
) -> Array:
    """W, shape (4, 4), that fits images best beside a camera at E.

    Of poses the mean, of pixels by least squares from there on. there : ndarray of bool, shape (m,),
    which images show C
    """
    places = carried[there] @ E @ C[there]
    R, t = nearest_rotation(places[:, :3, :3].sum(axis=0)), places[:, :3, 3].mean(axis=0)
    camera = pair.instrument
    if not isinstance(camera, Camera):
        return transform(R, t)
    away, seen = inverse(carried @ E), data.seen[:, pair.part]
    measured = data.readings[:, pair.part, :2]

    def linearise(xi: Array) -> tuple[Array, Array]:
        shown, _, by = moved_as_one(xi, pair.points)
        own = transformed(away[:, None], shown[..., None, :, :])
        rows, by_points, _ = camera.lens.linearise(own)
        J = by_points @ (away[:, None, :3, :3] @ by[..., None, :, :, :])
        J = J * seen[..., None, None]
        r = (measured - rows) * seen[..., None]
        flat = (*xi.shape[:-1], -1)
        return r.reshape(flat) / camera.sigma, J.reshape((*flat, 6)) / camera.sigma

    xi = levenberg_marquardt(linearise, np.concatenate([t, so3_log(R)]), np.eye(6)).values
    return displacement(xi)


def alone(pair: Pair, data: Measurements, C: Array) -> float | None:
    """What images by themselves leave of a perfect prediction, px RMS of a point, None of poses.

    The residuals of C over their degrees of freedom.
    """
    camera = pair.instrument
    there = np.isfinite(C).all(axis=(1, 2))
    if not isinstance(camera, Camera) or not there.any():
        return None
    shown = transformed(C[there][:, None], pair.points)
    seen = data.seen[there, pair.part]
    off = (data.readings[there, pair.part, :2] - camera.lens.project(shown)) * seen[..., None]
    free = 2 * int(seen.sum()) - 6 * int(there.sum())
    return float(np.sqrt(2.0 * (off**2).sum() / free)) if free >= _TOLD else None


def folds(group: IntArray, count: int, rng: np.random.Generator) -> Iterator[Mask]:
    """Each of the configurations is held out once, in so many parts; masks (m,) of those held out."""
    number = int(group.max()) + 1
    part = rng.permutation(np.arange(number) % count)
    for k in range(min(count, number)):
        yield np.asarray(part[group] == k)
