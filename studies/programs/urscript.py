"""URScript of Universal Robots: movej to joint positions in radians."""

from __future__ import annotations

import re
from collections.abc import Sequence

from calib import Cell
from calib.errors import InputError
from studies.programs.stops import Program, Stop, head_lines

_JOINTS = ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")
_ACCELERATION = 0.3  # rad/s^2
_SPEED = 0.2  # rad/s
_SETTLE = 2.0  # s, before anything is measured


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
    lines = [
        f"def {identifier(name)}():",
        *(f"  # {line}" for line in (*head, *head_lines(cell, _JOINTS))),
        f"  # Speed {_SPEED} rad/s, acceleration {_ACCELERATION} rad/s^2; run it slower at first.",
        "  # A popup waits wherever something is to be measured.",
        f"  # Send the file as it is; within a Script node, call {identifier(name)}() after it.",
    ]
    for number, stop in enumerate(stops, start=1):
        target = ", ".join(f"{value + 0.0:.9f}" for value in stop.q)
        lines += [
            "  #",
            f"  # {number} of {len(stops)}: pose {stop.name}",
            f"  movej([{target}], a={_ACCELERATION}, v={_SPEED})",
            f"  sleep({_SETTLE})",
        ]
        for task in stop.tasks:
            lines.append(f'  popup("{task}", title="posecal", blocking=True)')
    return Program("\n".join([*lines, "end", ""]))


def identifier(text: str) -> str:
    """A name of letters, digits and ``_`` that begins with a letter and cannot be a keyword.

    >>> identifier("plan-2"), identifier("end")
    ('posecal_plan_2', 'posecal_end')
    """
    return "posecal_" + re.sub(r"[^A-Za-z0-9_]", "_", text)
