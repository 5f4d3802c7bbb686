"""Images and joints of different moments: a camera's latency, or clocks that are not alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.drive import along_axis
from calib.effects.protocol import (
    Displacement,
    Parameter,
    PoseEffect,
    State,
    Twist,
    displaced,
)
from calib.instruments import Camera
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class TimeOffset(PoseEffect):
    """The arm is where it will be, or was: ``q_read + delay q' + delay^2 / 2 q''`` at every joint.

    The image was taken ``delay`` after the joints were read. Only an arm that moves shows it, so that
    poses need a velocity. It moves the arm of all that reads: it is asked where one camera reads alone.

    axes : ndarray, shape (n, 6), unit displacement along each joint's variable
    clock : str, unit of the session's clock
    """

    axes: Array
    clock: str
    kind: ClassVar[str] = "time_offset"
    lasting: ClassVar[bool] = False
    uses: ClassVar[tuple[str, ...]] = ("velocity",)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        alone = len(context.instruments) == 1
        return tuple(
            f"camera:{i.name}" for i in context.instruments if alone and isinstance(i, Camera)
        )

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        robot = context.robot
        axes = np.array([along_axis(robot, joint) for joint in range(robot.dof)])
        return cls(where, axes, context.clock_unit)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        timed = self.clock == "s"
        unit = ("ms", 1e-3, 1e-2, 1.0) if timed else ("readings", 1.0, 0.1, 3.0)
        return (Parameter(self.kind, self.where, "delay", *unit),)

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        return self._twists(poses, self.initial)

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        return self._twists(state.poses, values)

    def displacements(self, poses: Poses, values: Array) -> tuple[Displacement, ...]:
        return displaced(self._twists(poses, 0.5 * values), values)

    def _twists(self, poses: Poses, values: Array) -> tuple[Twist, ...]:
        """How the joints follow the delay, at values (..., 1)."""
        if poses.velocity is None:
            return ()
        speed = np.broadcast_to(poses.velocity, (*values.shape[:-1], *poses.velocity.shape))
        if poses.acceleration is not None:
            speed = speed + values[..., None] * poses.acceleration
        moved = speed[..., None] * self.axes
        return tuple((j + 1, moved[..., j, :, None]) for j in range(len(self.axes)))
