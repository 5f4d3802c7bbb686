"""URScript of Universal Robots: movej to joint positions in radians."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calib import Cell
from calib.errors import InputError
from doe.day.duration import limits_of, paced
from studies.programs.stops import Program, Stop, head_lines

_JOINTS = ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")
_SPEED, _ACCELERATION = 0.2, 0.3  # rad/s and rad/s^2, where the cell knows none


def urscript(name: str, cell: Cell, stops: Sequence[Stop], head: Sequence[str]) -> Program:
    """A ``.script`` file. Raises InputError for a chain that is not six joints that turn.

    As the controller wants it: ``def`` and ``end`` in the first column, all between them indented.
    """
    robot = cell.robot
    slides = [joint for joint, slide in zip(robot.joints, robot.prismatic, strict=True) if slide]
    if robot.dof != len(_JOINTS) or slides:
        found = f"{robot.dof} joints" + (f", {slides[0]} slides" if slides else "")
        raise InputError(
            "URScript",
            "",
            f"needs six joints that turn; this chain has {found}",
            "take the joint angles from the plan",
        )
    speed, acceleration = _leading(cell)
    lines = [
        f"def {identifier(name)}():",
        *(f"  # {line}" for line in (*head, *head_lines(cell, _JOINTS))),
        f"  # Speed {speed:g} rad/s, acceleration {acceleration:g} rad/s^2; run it slower at first.",
        "  # A popup waits wherever something is to be measured.",
        f"  # Send the file as it is; within a Script node, call {identifier(name)}() after it.",
    ]
    for number, stop in enumerate(stops, start=1):
        lines += ["  #", f"  # {number} of {len(stops)}: pose {stop.name}"]
        if stop.before:
            lines.append(f'  popup("{stop.before}", title="posecal", blocking=True)')
        for q in stop.drives:
            target = ", ".join(f"{value + 0.0:.9f}" for value in q)
            lines.append(f"  movej([{target}], a={acceleration:g}, v={speed:g})")
        lines.append(f"  sleep({cell.pace.settle})")
        for task in stop.tasks:
            lines.append(f'  popup("{task}", title="posecal", blocking=True)')
    return Program("\n".join([*lines, "end", ""]))


def _leading(cell: Cell) -> tuple[float, float]:
    """Speed and acceleration that no joint exceeds when it leads the motion, rounded down."""
    if not paced(cell):
        return _SPEED, _ACCELERATION
    speeds, accelerations = limits_of(cell)
    return tuple(np.floor(1e3 * own.min()) / 1e3 for own in (speeds, accelerations))


def identifier(text: str) -> str:
    """A name of letters, digits and ``_`` that begins with a letter and cannot be a keyword.

    >>> identifier("plan-2"), identifier("end")
    ('posecal_plan_2', 'posecal_end')
    """
    return "posecal_" + re.sub(r"[^A-Za-z0-9_]", "_", text)
