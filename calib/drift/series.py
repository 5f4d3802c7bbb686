"""One configuration read several times through the day, and how its markers moved as a rigid body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size
from calib.observations.shape import rigid_motions
from calib.poses import Measurements
from calib.poses.moves import alike, visits
from calib.scatter import Scatter

_BLIND = 1e-6  # share of the largest: information on a motion that the markers do not show


@dataclass(frozen=True, eq=False)
class Motion:
    """The rigid motion that carries the markers of the first reading onto those of a later one.

    pose : str; time : float, s since the first reading, NaN where none is given
    translation, translation_std : ndarray, shape (3,), m, of the markers' centroid, axes of the station
    rotation, rotation_std : ndarray, shape (3,), rad; zero where the markers do not show it
    length : float, m, root mean square over the markers of how far they moved
    markers : int, seen in both; rank : int, of the six motions that they show: 3, 5 or 6
    p : float, probability of so much under the noise alone
    """

    pose: str
    time: float
    translation: Array
    translation_std: Array
    rotation: Array
    rotation_std: Array
    length: float
    markers: int
    rank: int
    p: float


@dataclass(frozen=True, eq=False)
class Series:
    """Readings at equal joints and loads, the arm elsewhere in between; V of them.

    names : tuple of str, each the first pose of its stay; station : int
    time : ndarray, shape (V,), s, in order of measurement; the number of the stay where none is given
    timed : bool; one_side : bool, no joint came now from one side and now from the other
    points : ndarray, shape (V, M, 3), m, means of each stay
    information : ndarray, shape (V, 3 M, 3 M), 1/m^2, zero where hidden: of the points, and of how far
        the arm returns, which moves all of them together
    """

    names: tuple[str, ...]
    station: int
    time: Array
    timed: bool
    one_side: bool
    points: Array
    information: Array

    @property
    def seen(self) -> Mask:
        """Which markers were seen at each reading, shape (V, M)."""
        return np.asarray(self.information.any(axis=-1).reshape(self.points.shape).any(axis=-1))

    @cached_property
    def mean(self) -> Array:
        """Weighted mean of each marker, shape (M, 3), m; zero where it was never seen."""
        weighted = (self.information @ flat(self.points)[..., None])[..., 0].sum(axis=0)
        return solved(self.information.sum(axis=0), weighted).reshape(-1, 3)

    @property
    def deviations(self) -> Array:
        """Points minus their mean, shape (V, M, 3), m, zero where hidden."""
        return np.asarray((self.points - self.mean) * self.seen[..., None])

    def motions(self) -> tuple[Motion, ...]:
        """How the markers stand at each later reading against the first, where both show one."""
        found: dict[int, Motion] = {}
        patterns, which = np.unique(self.seen, axis=0, return_inverse=True)
        for k, seen in enumerate(patterns):
            later = np.flatnonzero(which.reshape(-1) == k)
            later, both = later[later > 0], seen & self.seen[0]
            if len(later) and both.any():
                found |= zip(later.tolist(), self._motions(later, both), strict=True)
        return tuple(found[v] for v in sorted(found))

    def _motions(self, later: IntArray, both: Mask) -> Iterator[Motion]:
        """Of readings that see the same markers, ``both`` (M,) of them as the first does."""
        from scipy.special import chdtrc

        own = np.repeat(both, 3)
        moved = (self.points[later] - self.points[0])[:, both]
        first, each = (self._errors(i)[:, own][..., own] for i in (np.zeros(1, dtype=int), later))
        columns, length = columns_about(self.points[0, both], self.points[0, both].mean(axis=0))
        weighted = np.swapaxes(np.linalg.solve(first + each, columns), -1, -2)
        cov, rank = inverse(weighted @ columns)
        b = (weighted @ flat(moved)[..., None])[..., 0]
        xi, std = (cov @ b[..., None])[..., 0], np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
        size = np.sqrt((moved**2).sum(axis=-1).mean(axis=-1))
        p = chdtrc(rank, (b * xi).sum(axis=-1))
        for i, v in enumerate(later.tolist()):
            yield Motion(
                self.names[v],
                float(self.time[v] - self.time[0]) if self.timed else np.nan,
                xi[i, :3],
                std[i, :3],
                xi[i, 3:] / length,
                std[i, 3:] / length,
                float(size[i]),
                int(both.sum()),
                int(rank[i]),
                float(p[i]),
            )

    def _errors(self, readings: IntArray) -> Array:
        """Covariances (.., 3 M, 3 M) of the points of readings that see the same, zero where hidden."""
        own = np.repeat(self.seen[readings[0]], 3)
        blank = np.diag(np.where(own, 0.0, 1.0))
        return np.asarray(np.linalg.inv(self.information[readings] + blank) - blank)


def series_of(data: Measurements, weights: Array, arm: Scatter | None = None) -> list[Series]:
    """Every configuration that was left and read again, the one with most readings first, then by time.

    weights : ndarray, shape (m, M, 3, 3), 1/m, whitening matrices, zero where hidden
    arm : Scatter, how the poses of the data err as a whole at each approach; None where they do not
    """
    stay, state = visits(data.poses), alike(data.poses)
    counted = weights.any(axis=(1, 2, 3))
    own = np.flatnonzero(counted)
    groups = [own[here] for index in by_size(state[counted]) for here in _left(index, stay[own])]
    groups.sort(key=lambda here: int(state[here[0]]))
    found = [_series(data, weights, here, stay[here], arm) for here in groups]
    return sorted(found, key=lambda series: (-len(series.names), series.time[0]))


def _left(index: IntArray, stay: IntArray) -> IntArray:
    """Those of groups of readings (B, r) that are of several stays."""
    return np.asarray(index[(stay[index] != stay[index[:, :1]]).any(axis=1)])


def _series(
    data: Measurements, weights: Array, here: IntArray, stay: IntArray, arm: Scatter | None
) -> Series:
    poses = data.poses
    own = np.swapaxes(weights[here], -1, -2) @ weights[here]
    weighted = (own @ data.points[here][..., None])[..., 0]
    order = np.argsort(stay, kind="stable")
    starts = np.flatnonzero(np.diff(stay[order], prepend=-1))
    each, sums = (np.add.reduceat(a[order], starts) for a in (own, weighted))
    times = stay.astype(float) if poses.time is None else poses.time[here]
    counts = np.diff(starts, append=len(stay))
    together = np.zeros((each.shape[1] * 3, 0))
    if arm is not None:
        levers = arm.levers[here[0]] * np.sqrt(arm.variances.approach[arm.kinds])
        together = levers.reshape(len(together), -1)
    return Series(
        tuple(poses.names[i] for i in here[order[starts]]),
        int(poses.station[here[0]]),
        np.add.reduceat(times[order], starts) / counts,
        poses.time is not None,
        poses.approach is None or _one_sided(poses.approach[here]),
        solved(each, sums),
        _beside_arm(each, together),
    )


def _beside_arm(each: Array, H: Array) -> Array:
    """Information (V, 3 M, 3 M) of points that err by themselves and all together.

    each : ndarray, shape (V, M, 3, 3), 1/m^2, of the points; H : ndarray, shape (3 M, k), m, levers
        of a standard deviation each
    """
    V, M = each.shape[:2]
    blocks = np.zeros((V, M, 3, M, 3))
    blocks[:, np.arange(M), :, np.arange(M)] = np.swapaxes(each, 0, 1)
    P = blocks.reshape(V, 3 * M, 3 * M)
    within = np.eye(H.shape[1]) + H.T @ P @ H
    return np.asarray(P - P @ H @ np.linalg.solve(within, H.T @ P))  # Woodbury


def _one_sided(approach: Array) -> bool:
    return bool((approach.min(axis=0) * approach.max(axis=0) >= 0.0).all())


def solved(information: Array, weighted: Array) -> Array:
    """Means (..., n) from weighted sums; zero where nothing was seen."""
    blank = np.logical_not(information.any(axis=-1))[..., None] * np.eye(information.shape[-1])
    return np.asarray(np.linalg.solve(information + blank, weighted[..., None])[..., 0])


def flat(points: Array) -> Array:
    """Points (..., M, 3) as vectors (..., 3 M)."""
    return points.reshape(*points.shape[:-2], -1)


def columns_about(points: Array, centre: Array) -> tuple[Array, float]:
    """Rigid motions of points (M, 3) about a centre, (3 M, 6), turns in units of their spread.

    Returns the columns and that spread, m, one where there is none.
    """
    arms = points - centre
    spread = float(np.sqrt((arms**2).sum(axis=-1).mean())) or 1.0
    columns = rigid_motions(arms).reshape(-1, 6)
    columns[:, 3:] /= spread
    return columns, spread


def inverse(A: Array) -> tuple[Array, IntArray]:
    """Pseudoinverse of information matrices (..., k, k), and their ranks: what is not shown is zero."""
    values, vectors = np.linalg.eigh(A)
    shown = values > _BLIND * values[..., -1:]
    scaled = vectors * np.where(shown, 1.0 / np.where(shown, values, 1.0), 0.0)[..., None, :]
    return scaled @ np.swapaxes(vectors, -1, -2), np.asarray(shown.sum(axis=-1))
