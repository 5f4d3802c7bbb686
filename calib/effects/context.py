"""What an effect is told about the robot and the cell when it is placed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib.arm.robot import Robot
from calib.arm.statics import STANDARD_GRAVITY, Payload
from calib.arrays import Array
from calib.errors import EffectCannotAct
from calib.instruments import TRACKER, Camera, Instrument
from calib.instruments.board import Board
from calib.instruments.protocol import MOTION, SCALE

ARM = "arm"
"""The place that stands for all links, or all joints, at once."""


class Expectation(NamedTuple):
    """What is known of a cause at a place before anything is measured.

    odds : how often it is met there, beside a cause that any arm may have
    twin_odds : how often it is the cause where the readings do not tell it from another
    allowance : by how many times the usual limits such errors may be larger on this arm
    instead : why it is not asked at all, empty where it is
    """

    odds: float = 1.0
    allowance: float = 1.0
    instead: str = ""
    twin_odds: float = 1.0


class MovablePart(NamedTuple):
    """What may come loose: in how many numbers, which markers on the tip it is, and of what shape."""

    numbers: int
    body: slice | None
    board: Board | None = None


@dataclass(frozen=True, eq=False)
class Context:
    """What an effect may ask for when it is placed.

    robot : Robot
    markers : ndarray, shape (M, 3), m, first guesses in the tip frame
    marker_names, stations : tuple of str
    knots : dict, joint name -> ndarray, rad, where ``stiffness_vs_angle`` has coefficients
    anchors : dict, joint name -> ndarray, shape (2, 3), m: spring anchors of a gravity
        compensator, on the link before the joint and on the link after it
    gravity : ndarray, shape (3,), m/s^2, base axes
    payload : Payload, as given
    measured_load : whether the poses bring a load of their own: a wrench, or a plan's [load]
    lacking : frozenset of str, covariates that the poses in hand do not have
    clock_unit : str, of the session's clock, "s" or "reading"
    gear_ratios : dict, joint name -> float, turns of motor or wave generator a turn of the joint
    instruments : tuple of Instrument
    bodies : dict, name -> slice, the markers that are points of it
    seats : dict, link -> slice, three that stand for one on which an instrument rides
    """

    robot: Robot
    markers: Array
    marker_names: tuple[str, ...]
    stations: tuple[str, ...] = ("base",)
    knots: Mapping[str, Array] = field(default_factory=dict)
    anchors: Mapping[str, Array] = field(default_factory=dict)
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    payload: Payload = field(default_factory=Payload)
    measured_load: bool = False
    lacking: frozenset[str] = frozenset()
    clock_unit: str = "s"
    gear_ratios: Mapping[str, float] = field(default_factory=dict)
    instruments: tuple[Instrument, ...] = (TRACKER,)
    bodies: Mapping[str, slice] = field(default_factory=dict)
    seats: Mapping[str, slice] = field(default_factory=dict)

    @property
    def parts(self) -> Mapping[str, MovablePart]:
        """What may come loose of the instruments and of what they look at, by place."""
        found: dict[str, MovablePart] = {}
        for instrument in self.instruments:
            found |= {w: MovablePart(s.stop - s.start, None) for w, s in instrument.parts.items()}
            for board in instrument.boards if isinstance(instrument, Camera) else ():
                own = MovablePart(SCALE.stop, self.bodies.get(board.name), board)
                found[f"board:{board.name}"] = own
        return found

    def reads(self, kind: str) -> bool:
        """Whether there is an instrument of a kind."""
        return any(instrument.kind == kind for instrument in self.instruments)

    @property
    def single_markers(self) -> tuple[str, ...]:
        """Names of the markers that are markers of their own."""
        part = {
            i
            for own in (*self.bodies.values(), *self.seats.values())
            for i in range(own.start, own.stop)
        }
        return tuple(name for i, name in enumerate(self.marker_names) if i not in part)


def motion_of(part: MovablePart) -> slice:
    """The numbers of a part by which it moves without growing."""
    return slice(0, min(part.numbers, MOTION.stop))


def joint_index(context: Context, where: str) -> int:
    """Position of a joint in the chain."""
    return context.robot.joints.index(where)


def turning_joints(context: Context) -> tuple[str, ...]:
    """Names of the joints that turn."""
    robot = context.robot
    return tuple(j for j, slides in zip(robot.joints, robot.prismatic, strict=True) if not slides)


def needs(context_has: bool, effect: str, reason: str, remedy: str) -> None:
    """Refuse an effect that lacks what it needs, with EffectCannotAct."""
    if not context_has:
        raise EffectCannotAct(effect, reason, remedy)
