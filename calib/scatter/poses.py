"""Whole poses that err together: their levers, and the transformation that makes rows independent.

The whitened rows of one configuration have the covariance

    V = s^2 I + H C H^T + blockdiag(H_a U H_a^T)

with the levers H of its readings, H_a those of one approach. Its inverse Cholesky factor turns the
rows into innovations: each row less what the rows before it in the same configuration tell of it.
Poses that do not count have rows of zeros and stay so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.arm.kinematics import Frames, forward
from calib.arm.se3 import cross, rotate
from calib.arrays import Array, IntArray, Mask, stacked
from calib.cell import Repeatability
from calib.model import Model
from calib.poses import Poses
from calib.poses.visits import visits
from calib.scatter.variances import Variances, lever_of
from calib.solver import inverse_factor


@dataclass(frozen=True, eq=False)
class Mixing:
    """Inverse factors of the covariance, configuration by configuration.

    blocks : tuple of (poses (B, r), inverse factors (..., B, r R, r R)), of configurations with r
        readings
    scale : float, actual over stated standard deviation of the instrument
    """

    blocks: tuple[tuple[IntArray, Array], ...]
    scale: float

    def __call__(self, rows: Array) -> Array:
        """Independent rows of unit variance, from whitened ones, both (..., m, R, p)."""
        return self._applied([inverse for _, inverse in self.blocks], rows)

    def back(self, gains: Array) -> Array:
        """Gains on whitened rows, from those on the independent rows made of them, (..., m, R, p)."""
        return self._applied([np.swapaxes(i, -1, -2) for _, i in self.blocks], gains)

    def covariance(self, gains: Array) -> Array:
        """Covariance (p, p) of what follows whitened rows by ``gains`` (m, R, p)."""
        half = self._applied([np.swapaxes(np.linalg.inv(i), -1, -2) for _, i in self.blocks], gains)
        flat = stacked(half)
        return np.asarray(flat.T @ flat)

    def _applied(self, factors: list[Array], rows: Array) -> Array:
        out = np.empty(rows.shape)
        for (index, _), factor in zip(self.blocks, factors, strict=True):
            own = rows[..., index, :, :]
            stacked = own.reshape((*own.shape[:-3], -1, own.shape[-1]))
            out[..., index, :, :] = (factor @ stacked).reshape(own.shape)
        return out


@dataclass(frozen=True, eq=False)
class Scatter:
    """How m poses err as a whole.

    levers : ndarray, shape (m, C, r, n + 6): how each reading follows a displacement of each joint and
        of the tip; of a tracker's points in m/rad or 1
    lengths : ndarray of bool, shape (C, r), which numbers of the readings are lengths
    tip : ndarray, shape (m, 6, n + 6), how the tip follows them, translation first, base axes
    approach, configuration : ndarray of int, shape (m,)
    variances : Variances
    """

    levers: Array
    lengths: Mask
    tip: Array
    approach: IntArray
    configuration: IntArray
    variances: Variances

    @property
    def joints(self) -> int:
        """How many joints the arm has, n."""
        return int(self.levers.shape[-1]) - 6

    @property
    def kinds(self) -> IntArray:
        """Which variance each lever has, shape (n + 6,)."""
        return lever_of(self.joints)

    def at(self, variances: Variances) -> Scatter:
        """The same poses at other variances."""
        return replace(self, variances=variances)

    def take(self, index: Any) -> Scatter:
        """The scatter of the poses of an index array or mask."""
        return replace(
            self,
            levers=self.levers[index],
            tip=self.tip[index],
            approach=self.approach[index],
            configuration=self.configuration[index],
        )

    @property
    def has_approaches(self) -> bool:
        """Whether some configuration was approached more than once: that alone shows repeatability."""
        pairs = np.unique(np.column_stack([self.configuration, self.approach]), axis=0)
        return len(pairs) > len(np.unique(self.configuration))

    def point_variance(self, variances: Array) -> Array:
        """What variances (n + 2,) add to each reading, shape (m, C), of points 3-D, m^2."""
        squares = (self.levers**2 * variances[self.kinds]).sum(axis=-1)
        return np.asarray((squares * self.lengths).sum(axis=-1))

    def of_tip(self, variances: Array) -> Repeatability:
        """What variances (n + 2,) do to the tip, on average over the configurations."""
        first = np.unique(self.configuration, return_index=True)[1]
        squares = (self.tip[first] ** 2 * variances[self.kinds]).sum(axis=-1).mean(axis=0)
        return Repeatability(float(np.sqrt(squares[:3].mean())), float(np.sqrt(squares[3:].mean())))

    def typical(self, weighted: Array) -> float:
        """Root mean square of the whitened rows under the variances.

        weighted : ndarray, shape (m, R, n + 6), the levers, whitened as the rows are
        """
        v = self.variances
        squares = (weighted**2 * (v.approach + v.configuration)[self.kinds]).sum(axis=-1)
        counted = np.abs(weighted).sum(axis=-1) > 0.0
        return float(np.sqrt(v.scale**2 + squares[counted].mean()))

    def mixing(self, weighted: Array) -> Mixing:
        """What makes whitened rows independent.

        weighted : ndarray, shape (..., m, R, n + 6), the levers, whitened as the rows are
        """
        groups = by_size(self.configuration)
        blocks = tuple((index, self._inverse(index, weighted)) for index in groups)
        return Mixing(blocks, self.variances.scale)

    def _inverse(self, index: IntArray, weighted: Array) -> Array:
        (B, r), R = index.shape, weighted.shape[-2]
        known, own = self.variances, weighted[..., index, :, :]
        H = own.reshape((*own.shape[:-4], B, r * R, -1))
        V = (H * known.configuration[self.kinds]) @ np.swapaxes(H, -1, -2)
        if known.approach.any():
            moved = (H * known.approach[self.kinds]) @ np.swapaxes(H, -1, -2)
            V = V + moved * _together(self.approach[index], R)
        V = V + known.scale**2 * np.eye(r * R)
        return inverse_factor(V)


def scatter_of(model: Model, values: Array, poses: Poses, variances: Variances) -> Scatter:
    """The levers of poses, at the nominal arm and unloaded: equal joints have equal ones.

    values : ndarray, shape (p,), SI, for base and markers
    """
    robot, frames = model.robot, forward(model.robot, poses.q)
    R_tip, o_tip = frames.R[:, -1], frames.o[:, -1]
    points = rotate(R_tip[:, None], model.marker_positions(values)) + o_tip[:, None]
    axes = [_axis(model, frames, k) for k in range(robot.dof)]
    moved = [_moved(slides, axis, points - o[:, None]) for slides, axis, o in axes]
    turned = [cross(unit, points - o_tip[:, None]) for unit in np.eye(3)]
    still = [np.broadcast_to(unit, points.shape) for unit in np.eye(3)]
    levers = np.stack([*moved, *still, *turned], axis=-1)
    return Scatter(
        model.readout.follow(values, poses, points, levers),
        model.readout.channels.lengths,
        _tip_levers(axes, o_tip),
        visits(poses),
        poses.configuration,
        variances,
    )


def by_size(group: IntArray) -> list[IntArray]:
    """Members (B, r) of the groups with r members, in their order, an array for each r.

    group : ndarray of int, shape (m,)
    """
    order = np.argsort(group, kind="stable")
    _, starts, counts = np.unique(group[order], return_index=True, return_counts=True)
    return [order[starts[counts == r][:, None] + np.arange(r)] for r in np.unique(counts).tolist()]


def _together(approach: IntArray, R: int) -> Array:
    """One where two rows share an approach, shape (B, r R, r R); approach has shape (B, r)."""
    alike = approach[:, :, None] == approach[:, None, :]
    return np.repeat(np.repeat(alike, R, axis=1), R, axis=2).astype(float)


def _axis(model: Model, frames: Frames, k: int) -> tuple[bool, Array, Array]:
    """Whether joint k slides, its axis (m, 3) and its origin (m, 3), base axes."""
    robot = model.robot
    return bool(robot.prismatic[k]), rotate(frames.R[:, k + 1], robot.axes[k]), frames.o[:, k + 1]


def _moved(slides: bool, axis: Array, away: Array) -> Array:
    """Velocity of points (m, M, 3) away from a joint's origin."""
    if slides:
        return np.broadcast_to(axis[:, None], away.shape)
    return cross(axis[:, None], away)


def _tip_levers(axes: list[tuple[bool, Array, Array]], o_tip: Array) -> Array:
    m, n = len(o_tip), len(axes)
    J = np.zeros((m, 6, n + 6))
    for k, (slides, axis, o) in enumerate(axes):
        J[:, :3, k] = _moved(slides, axis, (o_tip - o)[:, None])[:, 0]
        J[:, 3:, k] = 0.0 if slides else axis
    J[:, :, n:] = np.eye(6)
    return J
