"""What an effect knows of the robot and the cell when it is placed, and how large its errors may be.

What is known before anything is measured is a prior, never a wall: it weighs causes against each other
and says which size is far out. A drive is chosen for what it carries, so that it turns by about a
milliradian under the weight of the arm. Strain-wave gears of small arms yield by 15 to 210 urad/(N m)
(Harmonic Drive, CSF catalogue, K1 of sizes 32 to 14), cycloidal gears of large ones by 0.3 to 6
(Nabtesco, RV-E catalogue, RV-320E to RV-20E).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from calib.cell import Cell
from calib.errors import EffectCannotAct
from calib.instruments import Camera
from calib.instruments.board import Board
from calib.instruments.protocol import MOTION, SCALE

ARM = "arm"
"""The place that stands for all links, or all joints, at once."""
_TURNS, _LIGHT_TURNS = 1e-3, 2.5e-3  # rad, of a joint under the weight of its arm; of a light arm
_LEVER = 0.25  # of the reach, at which the arm's weight pulls, on average over joints and poses
_DENSITY, _POWER = 50.0, 2.5  # kg of an arm with a reach of one metre, and how that grows
_LIGHT = 22.0  # kg for each metre of reach, of the lightest: UR3 to UR10, iiwa, Panda (data sheets)
_HEAVY = 100.0  # kg: of 2.7 m, a KR 270 has 1100 kg; of 1.3 m, a UR10 has 29
_INDUSTRIAL = 30.0  # kg for each metre of reach: above, gears have a stated lost motion
_SOFT = 1e-5  # rad/(N m), of the arm for which the limits of compliances stand
_G = 9.80665


class Expectation(NamedTuple):
    """What is known of a cause at a place before anything is measured.

    odds : how often it is met there, beside a cause that any arm may have
    twin_odds : how often it is the cause where the readings do not separate it from another
    allowance : by how many times the usual limits such errors may be larger on this arm
    instead : why it is no candidate at all, empty where it is
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


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Context(Cell):
    """A cell, and what the poses in hand say of it, as far as effects may ask.

    stations : tuple of str, places of the tracker
    measured_load : whether the poses bring a load of their own: a wrench, or a plan's [load]
    lacking : frozenset of str, covariates that the poses in hand do not have
    clock_unit : str, of the session's clock, "s" or "reading"
    parameters : names of those that a result has of the effect to be placed, None without a result
    """

    stations: tuple[str, ...] = ("base",)
    measured_load: bool = False
    lacking: frozenset[str] = frozenset()
    clock_unit: str = "s"
    parameters: tuple[str, ...] | None = None

    @property
    def parts(self) -> Mapping[str, MovablePart]:
        """What may come loose of the instruments and of what they look at, by place."""
        parts: dict[str, MovablePart] = {}
        for instrument in self.instruments:
            parts |= {w: MovablePart(s.stop - s.start, None) for w, s in instrument.parts.items()}
            for board in instrument.boards if isinstance(instrument, Camera) else ():
                part = MovablePart(SCALE.stop, self.bodies.get(board.name), board)
                parts[f"board:{board.name}"] = part
        return parts

    def reads(self, kind: str) -> bool:
        """Whether there is an instrument of a kind."""
        return any(instrument.kind == kind for instrument in self.instruments)


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


def weight(context: Context) -> float:
    """Mass of the moving arm, kg: as its file has it, else that of an industrial arm of its reach."""
    known = float(context.robot.masses.sum())
    return known or _DENSITY * context.robot.reach**_POWER


def softness(context: Context) -> float:
    """By how much a joint usually yields, rad/(N m)."""
    carried = weight(context) * _LEVER + context.payload.mass
    return _TURNS / (carried * _G * context.robot.reach)


def softest(context: Context) -> float:
    """The same, rad/(N m), with strain-wave gears where the arm may be light."""
    reach, known = context.robot.reach, float(context.robot.masses.sum())
    if not light(context):
        return softness(context)
    carried = (known or _LIGHT * reach) * _LEVER + context.payload.mass
    return _LIGHT_TURNS / (carried * _G * reach)


def softer(context: Context) -> float:
    """How many times softer than an arm of 10 kg and a metre's reach it may be; one at least."""
    return max(1.0, softness(context) / _SOFT)


def heavy(context: Context) -> bool:
    """Whether makers build springs and large gears into an arm of this weight."""
    return weight(context) >= _HEAVY


def light(context: Context) -> bool:
    """Whether it may be a service robot: its known weight is small, or nothing is known of it."""
    return float(context.robot.masses.sum()) < _INDUSTRIAL * context.robot.reach
