"""One configuration read several times through the day, and how its markers moved as a rigid body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.observations.rigid import rigid_motions
from calib.poses import Measurements
from calib.poses.visits import alike, visits
from calib.scatter import Scatter

_BLIND = 1e-6  # share of the largest: information on a motion that the markers do not show


@dataclass(frozen=True, eq=False)
class Motion:
    """The rigid motion that carries the markers of the first reading onto those of a later one.

    pose : str; time : float, s since the first reading, NaN where none is given
    shift, shift_std : ndarray, shape (3,), m, of the markers' centroid, axes of the station
    turn, turn_std : ndarray, shape (3,), rad; zero where the markers do not show it
    length : float, m, root mean square over the markers of how far they moved
    markers : int, seen in both; rank : int, of the six motions that they show: 3, 5 or 6
    p : float, probability of so much under the noise alone
    """

    pose: str
    time: float
    shift: Array
    shift_std: Array
    turn: Array
    turn_std: Array
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
        common = self.seen[0] & self.seen
        return tuple(self._motion(v, common[v]) for v in range(1, len(common)) if common[v].any())

    def _motion(self, v: int, both: Mask) -> Motion:
        from scipy.special import chdtrc

        own = np.repeat(both, 3)
        moved = (self.points[v] - self.points[0])[both]
        error = sum(self._errors(i)[np.ix_(own, own)] for i in (0, v))
        columns, length = columns_about(self.points[0, both], self.points[0, both].mean(axis=0))
        weighted = np.linalg.solve(error, columns).T
        cov, rank = inverse(weighted @ columns)
        b = weighted @ moved.ravel()
        xi, std = cov @ b, np.sqrt(np.diag(cov))
        return Motion(
            self.names[v],
            float(self.time[v] - self.time[0]) if self.timed else np.nan,
            xi[:3],
            std[:3],
            xi[3:] / length,
            std[3:] / length,
            float(np.sqrt((moved**2).sum(axis=-1).mean())),
            int(both.sum()),
            int(rank),
            float(chdtrc(rank, b @ xi)),
        )

    def _errors(self, v: int) -> Array:
        """Covariance (3 M, 3 M) of the points of a reading, zero where hidden."""
        found, own = np.zeros_like(self.information[v]), np.repeat(self.seen[v], 3)
        found[np.ix_(own, own)] = np.linalg.inv(self.information[v][np.ix_(own, own)])
        return np.asarray(found)


def series_of(data: Measurements, weights: Array, arm: Scatter | None = None) -> list[Series]:
    """Every configuration that was left and read again, the one with most readings first, then by time.

    weights : ndarray, shape (m, M, 3, 3), 1/m, whitening matrices, zero where hidden
    arm : Scatter, how the poses of the data err as a whole at each approach; None where they do not
    """
    stay, state = visits(data.poses), alike(data.poses)
    counted = weights.any(axis=(1, 2, 3))
    found = []
    for s in np.unique(state[counted]):
        here = np.flatnonzero((state == s) & counted)
        if len(np.unique(stay[here])) > 1:
            found.append(_series(data, weights, here, stay[here], arm))
    return sorted(found, key=lambda series: (-len(series.names), series.time[0]))


def _series(
    data: Measurements, weights: Array, here: IntArray, stay: IntArray, arm: Scatter | None
) -> Series:
    poses = data.poses
    own = np.swapaxes(weights[here], -1, -2) @ weights[here]
    weighted = (own @ data.points[here][..., None])[..., 0]
    stays = np.unique(stay)
    each = np.stack([own[stay == s].sum(axis=0) for s in stays])
    sums = np.stack([weighted[stay == s].sum(axis=0) for s in stays])
    times = stay.astype(float) if poses.time is None else poses.time[here]
    together = np.zeros((each.shape[1] * 3, 0))
    if arm is not None:
        levers = arm.levers[here[0]] * np.sqrt(arm.variances.approach[arm.kinds])
        together = levers.reshape(len(together), -1)
    return Series(
        tuple(poses.names[here[int(np.argmax(stay == s))]] for s in stays),
        int(poses.station[here[0]]),
        np.array([times[stay == s].mean() for s in stays]),
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
