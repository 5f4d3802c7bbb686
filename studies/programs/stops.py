"""What every language drives to: the stops of a plan, and text that is safe in a program."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from calib import Cell
from calib.arrays import Array
from calib.errors import InputError
from doe.day.day import PlannedDay
from doe.day.ways import broken_at

_OUTSIDE = 1e-4  # rad or m beyond a limit: rounding of the plan
_LONGEST_NAME = 60  # characters of a pose shown in a program


@dataclass(frozen=True)
class Stop:
    """One pose of a plan.

    name : of the pose, safe in comments and strings
    q : ndarray, shape (n,), rad or m
    tasks : what is done there, one line for each time that the program waits
    between : tuple of ndarray, shape (n,), rad or m, points on the way from the stop before
    before : what the program waits for before it goes there, "" for nothing
    """

    name: str
    q: Array
    tasks: tuple[str, ...]
    between: tuple[Array, ...] = ()
    before: str = ""

    @property
    def drives(self) -> Array:
        """The points to which the program drives in turn, shape (k + 1, n), the pose last."""
        return np.array([*self.between, self.q])


@dataclass(frozen=True)
class Program:
    """The text of a program and what a reader should know of it."""

    text: str
    notes: tuple[str, ...] = ()


Language: TypeAlias = Callable[[str, Cell, Sequence[Stop], Sequence[str]], Program]
"""(name of the file without its ending, cell, stops, lines for the head) -> Program."""


def plan_stops(day: PlannedDay, source: str) -> list[Stop]:
    """The poses of a plan in their order, each measured free and, if the cell has a load, loaded.

    The load is hung and taken off at the pose, and the arm never moves with it; but in blocks of load
    each pose is a stop twice.

    source : the plan's file, for messages

    Raises InputError for a pose beyond the joint limits, a last move that begins there, a pose where
    the arm meets something, and joints that mimic others: what a controller drives in their place is
    its own.
    """
    cell, plan = day.cell, day.stops
    for mimic in cell.robot.mimics:
        raise InputError(
            cell.path,
            f"joint {mimic.joint}",
            f"mimics {mimic.master}, and no language here has an axis for both",
            f"drive {mimic.master} by hand to the values of the plan, and begin the chain after it",
        )
    for coupling in cell.robot.couplings:
        raise InputError(
            cell.path,
            f"joint {coupling.joint}",
            f"is moved by {' and '.join(name for name, _ in coupling.factors)}, and no language here "
            "has an axis without a drive",
            "drive the arm by hand to the values of the plan",
        )
    stops = []
    meets = broken_at(cell, plan.q)
    arrivals = (day.first, *day.ways)
    for name, q, met, way, between, tasks in zip(
        plan.names, plan.q, meets, arrivals, day.before, _tasks(day), strict=True
    ):
        shown = plain_text(name)
        mend = f"take the pose out or mend the limits in {cell.robot.source} and cell"
        _check_limits(cell, q, source, f"pose {shown}", mend)
        for point in between:
            mend = "let the joint come from its other side (approach_..), or by less (move_..)"
            _check_limits(cell, point, source, f"the last move to pose {shown}", mend)
        if met:
            raise InputError(
                source,
                f"pose {shown}",
                f"is where the arm does not keep clear: {met}",
                "take the pose out, or correct shapes, obstacles and margin in the cell",
            )
        before = "" if way is None or way.free else (
            f"no way to pose {shown} is known: the straight one meets {way.meets}. Drive there by hand"
        )  # fmt: skip
        stops.append(Stop(shown, q, tasks, tuple(between), plain_text(before, len(before))))
    return stops


def _tasks(day: PlannedDay) -> Iterator[tuple[str, ...]]:
    """What is done at each stop."""
    load, blocks = day.cell.load, day.poses.load_block is not None
    hang = "" if load is None else f"hang {load.mass:g} kg, wait until it is still, "
    for name, mass, change in zip(day.stops.names, day.stops.load_mass, day.changes, strict=True):
        measure = f"measure pose {plain_text(name)}"
        if blocks:
            off = hang if mass else "take the load off, wait until the arm is still, "
            yield (f"{off}{measure}" if change else measure,)
        elif load is not None:
            yield (f"{measure} free of the load", f"{hang}{measure}, take it off")
        else:
            yield (measure,)


def checked_lines(day: PlannedDay) -> list[str]:
    """What is known of the ways between the poses."""
    carried = []
    if day.cell.load is not None and day.changes.any():
        carried.append(
            f"Between changes of the load the arm moves with {day.cell.load.mass:g} kg: give the "
            "controller the load data where it is hung, and take them out where it is taken off."
        )
    if not day.checked:
        return [
            "The way from pose to pose is not checked for collisions: look at it first.",
            *carried,
        ]
    margin = day.cell.design.margin
    apart = f", with a margin of {1e3 * margin:g} mm to floor and obstacles" if margin else ""
    around = sum(way.free and bool(way.meets) for way in day.ways)
    lines = [
        f"Ways from pose to pose, checked for {', '.join(day.checked)}{apart}: {day.direct} straight, "
        f"{around} over points between, {len(day.blocked)} not known.",
        "Checked are straight motions of all joints together, by the capsules of arm and tool, without "
        "cables and load. The way to the first pose is not checked.",
    ]
    followed = sorted({way.follows for way in day.ways} - {""})
    if followed:
        lines.append(f"On each way one marker stays in sight: {', '.join(followed)}.")
    return [plain_text(line, len(line)) for line in (*lines, *carried)]


def head_lines(cell: Cell, axes: Sequence[str]) -> list[str]:
    """What a program takes for granted, to be checked by whoever runs it; all but the ways.

    axes : the controller's name of each joint
    """
    pairs = ", ".join(
        f"{axis} = {plain_text(joint)}" for axis, joint in zip(axes, cell.robot.joints, strict=True)
    )
    return [
        f"Axes: {pairs}",
        f"Taken from the {cell.robot.source} and to be checked: zero positions and senses of "
        "rotation of all axes.",
        "Tool and load data of the controller are not set here: select them first.",
        "Record the joint values that the controller reads at each pose; they go into the data.",
    ]


def plain_text(text: str, longest: int = _LONGEST_NAME) -> str:
    """Letters, digits and harmless signs of a name; all else becomes ``_``, and it is cut short.

    >>> plain_text('p1"); halt()' + chr(10) + 'END')
    'p1_)_ halt()_END'
    """
    return re.sub(r"[^A-Za-z0-9 _.:,=+()@%-]", "_", text)[:longest]


def _check_limits(cell: Cell, q: Array, source: str, where: str, mend: str) -> None:
    """Raise InputError for a point (n,), rad or m, beyond a joint's limits."""
    robot = cell.robot
    outside = (q < robot.limits[:, 0] - _OUTSIDE) | (q > robot.limits[:, 1] + _OUTSIDE)
    for j in np.flatnonzero(outside):
        shown = f"{q[j] * 1e3:.3f} mm" if robot.prismatic[j] else f"{np.degrees(q[j]):.3f} deg"
        raise InputError(
            source, where, f"joint {robot.joints[j]} at {shown} is beyond its limits", mend
        )
