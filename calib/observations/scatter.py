"""How whole poses err together, and whose it is.

A reading of approach a in configuration k errs by ``J_k (c_k + u_a) + e``: e is the instrument's and
new at every point, u_a the arm's repeatability and new at every approach, c_k what no model follows
from one configuration to the next: it comes again at the same joints. J_k moves the joints and the tip.
Their variances are estimated in :mod:`calib.identification.variances`.

Poses that are approached again, or the cell, say how the arm comes back to a pose. What differs from
configuration to configuration beside that is systematic, and so the model's. Where nothing separates
the arm from the model, data sheets of arms of its size do: more than the worst of them is the model's,
less is undecided.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.repeatability import Usual, usual_repeatability
from calib.arm.se3 import cross, rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Repeatability
from calib.inference.decorrelation import Groups, InverseRoot
from calib.model import Model
from calib.poses import Poses
from calib.poses.moves import visits

if TYPE_CHECKING:
    from calib.identification.variances import VarianceEstimate

Owner: TypeAlias = Literal["instrument", "arm", "model", "undecided"]


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
        variances = cls.none(joints)
        if arm is not None:
            variances.approach[-2:] = arm.translation**2, arm.rotation**2
        return variances

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
        n = self.joints
        return np.concatenate([np.arange(n), np.repeat([n, n + 1], 3)])

    def at(self, variances: Variances) -> Scatter:
        """The scatter of the same poses under other variances."""
        return replace(self, variances=variances)

    def take(self, index: Any) -> Scatter:
        """The scatter of the poses of an index array or mask."""
        each = {name: getattr(self, name)[index] for name in ("levers", "tip", *_LEVELS)}
        return replace(self, **each)

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

    def mixing(self, weighted: Array) -> InverseRoot:
        """What makes whitened rows independent: approaches first, then configurations.

        weighted : ndarray, shape (..., m, R, n + 6), the levers, whitened as the rows are
        """
        levels = []
        for name in _LEVELS:
            size = np.sqrt(getattr(self.variances, name)[self.kinds]) / self.variances.scale
            if (moves := size > 0.0).any():
                levels.append((Groups.of(getattr(self, name)), weighted[..., moves] * size[moves]))
        return InverseRoot.of(self.variances.scale, levels)


_LEVELS = "approach", "configuration"


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
    still = [np.broadcast_to(unit, points.shape) for unit in np.eye(3)]
    turned = [cross(unit, points - o_tips) for unit in np.eye(3)]
    levers = np.stack([*moved, *still, *turned], axis=-1)
    tip[:, :, : robot.dof] *= robot.moving(robot.tip_frame)  # zero of what does not carry it
    for seat in model.readout.channels.seats:  # a tip scatters before what reads it
        levers[:, seat, :, robot.dof :] = 0.0
    levers = model.readout.follow(values, poses, points, levers)
    lengths, groups = model.readout.channels.lengths, (visits(poses), poses.configuration)
    return Scatter(levers, lengths, tip, *groups, variances)


def _moved(slides: bool, axis: Array, away: Array) -> Array:
    """Velocity of points (m, M, 3) away from a joint's origin."""
    return np.broadcast_to(axis[:, None], away.shape) if slides else cross(axis[:, None], away)


def scatter_variance(
    model: Model, values: Array, poses: Poses, variances: Variances | None
) -> Array:
    """Squared error (m, C), m^2, of the readings of a model where its arm is approached anew."""
    if variances is None or not variances.any:
        return np.zeros((len(poses), len(model.readout.channels.lengths)))
    total = variances.approach + variances.configuration
    return scatter_of(model, values, poses, variances).point_variance(total)


# -- whose it is -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class PoseToPose:
    """How poses err as a whole: one coordinate of the tip, m, and of its rotation, rad.

    arm : from approach to approach; None where neither the data nor the cell show it
    rest : from configuration to configuration; where ``arm`` is None, both; None where there is none
    usual : Usual, how arms of this size repeat by data sheets
    """

    arm: Repeatability | None
    rest: Repeatability | None
    usual: Usual

    @property
    def of(self) -> Owner:
        """Whose the rest is; where there is none, who is all that errs."""
        if self.rest is None:
            return "instrument" if self.arm in (None, Repeatability(0.0, 0.0)) else "arm"
        if self.arm is not None or self.rest.translation > self.usual.worst:
            return "model"
        return "undecided"


def pose_to_pose(
    levels: VarianceEstimate | None, scatter: Scatter | None, reach: float
) -> PoseToPose:
    """The judgement of a fit's variances.

    scatter : of the same readings; reach : m, of the arm (:attr:`calib.arm.robot.Robot.reach`)
    """
    usual = usual_repeatability(reach)
    if levels is None or scatter is None:
        return PoseToPose(None, None, usual)
    v = levels.variances
    arm = scatter.of_tip(v.approach) if levels.approaches or v.approach.any() else None
    return PoseToPose(
        arm, scatter.of_tip(v.configuration) if v.configuration.any() else None, usual
    )


def parted(variances: Variances, of: Owner) -> tuple[Variances, Variances]:
    """The variances that are the arm's, and those that are the model's.

    of : whose those of the configurations are; what is undecided counts as the arm's
    """
    none = np.zeros_like(variances.configuration)
    if of != "model":
        return variances, replace(variances, approach=none, configuration=none)
    return replace(variances, configuration=none), replace(variances, approach=none)
