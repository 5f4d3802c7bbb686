"""How whole poses err together: levers of each reading, and variances of joints and tip."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import cross, rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Repeatability
from calib.model import Model
from calib.poses import Poses
from calib.poses.moves import visits
from calib.scatter.mixing import Level, Mixing


@dataclass(frozen=True, eq=False)
class Variances:
    """Variances of n joints, of the tip's translation and of its rotation, each a coordinate.

    scale : float, actual over stated standard deviation of the instrument
    approach, configuration : ndarray, shape (n + 2,), rad^2 or m^2, of what is new at each
        approach, and at each configuration
    """

    scale: float
    approach: Array
    configuration: Array

    @classmethod
    def none(cls, joints: int) -> Variances:
        """The instrument alone, as stated."""
        return cls(1.0, np.zeros(joints + 2), np.zeros(joints + 2))

    @classmethod
    def of_arm(cls, joints: int, arm: Repeatability | None) -> Variances:
        """An arm of known repeatability; none where it is not known."""
        found = cls.none(joints)
        if arm is not None:
            found.approach[-2:] = arm.translation**2, arm.rotation**2
        return found

    @property
    def any(self) -> bool:
        """Whether anything errs as a whole."""
        return bool(self.approach.any() or self.configuration.any())


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
        return np.concatenate(
            [np.arange(self.joints), np.repeat([self.joints, self.joints + 1], 3)]
        )

    def at(self, variances: Variances) -> Scatter:
        """The scatter of the same poses under other variances."""
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
        """The decorrelation of whitened rows.

        weighted : ndarray, shape (..., m, R, n + 6), the levers, whitened as the rows are
        """
        v = self.variances
        mixing = Mixing((), v.scale)
        for group, own in ((self.approach, v.approach), (self.configuration, v.configuration)):
            size = np.sqrt(own[self.kinds])
            if (moves := size > 0.0).any():
                K = weighted[..., moves] * size[moves]
                level = Level.of(group, K / v.scale, mixing(K))
                mixing = Mixing((*mixing.levels, level), v.scale)
        return mixing


def scatter_of(model: Model, values: Array, poses: Poses, variances: Variances) -> Scatter:
    """The levers of poses, at the nominal arm and unloaded: equal joints have equal ones.

    values : ndarray, shape (p,), SI, for base and markers
    """
    robot, frames = model.robot, forward(model.robot, poses.q)
    R, o_tips = model.under_markers(frames)
    points = rotate(R, model.marker_positions(values)) + o_tips
    tip = np.zeros((len(poses), 6, robot.dof + 6))
    tip[:, :, robot.dof :] = np.eye(6)
    moved = []
    for k, slides in enumerate(robot.prismatic):
        axis, o = rotate(frames.R[:, k + 1], robot.axes[k]), frames.o[:, k + 1]
        by_joint = _moved(slides, axis, points - o[:, None])
        moved.append(by_joint * robot.carries[k + 1, model.marker_frames][:, None])
        tip[:, :3, k] = _moved(slides, axis, (frames.o[:, -1] - o)[:, None])[:, 0]
        tip[:, 3:, k] = 0.0 if slides else axis
    turned = [cross(unit, points - o_tips) for unit in np.eye(3)]
    still = [np.broadcast_to(unit, points.shape) for unit in np.eye(3)]
    levers = np.stack([*moved, *still, *turned], axis=-1)
    tip[:, :, : robot.dof] *= robot.moving(robot.tip_frame)  # zero of what does not carry it
    for seat in model.readout.channels.seats:  # a tip scatters before what reads it
        levers[:, seat, :, robot.dof :] = 0.0
    return Scatter(
        model.readout.follow(values, poses, points, levers),
        model.readout.channels.lengths,
        tip,
        visits(poses),
        poses.configuration,
        variances,
    )


def _moved(slides: bool, axis: Array, away: Array) -> Array:
    """Velocity of points (m, M, 3) away from a joint's origin."""
    if slides:
        return np.broadcast_to(axis[:, None], away.shape)
    return cross(axis[:, None], away)


def scatter_variance(
    model: Model, values: Array, poses: Poses, variances: Variances | None
) -> Array:
    """Squared error (m, C), m^2, of the readings of a model where its arm is approached anew."""
    if variances is None or not variances.any:
        return np.zeros((len(poses), len(model.readout.channels.lengths)))
    total = variances.approach + variances.configuration
    return scatter_of(model, values, poses, variances).point_variance(total)
