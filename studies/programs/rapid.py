"""RAPID of ABB: MoveAbsJ to axis values in degrees, mm for axes that slide."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calib import Cell
from calib.errors import InputError
from studies.programs.stops import Program, Stop, head_lines

_LONGEST_NAME = 32  # characters of a RAPID identifier
_ARM = 6  # axes of the robot; up to as many external ones
_UNUSED = "9E9"  # of an external axis
_SPEED = "v50"
_LONGEST_TEXT = 70  # characters of a line on the pendant; a string holds 80


def rapid(name: str, cell: Cell, stops: Sequence[Stop], head: Sequence[str]) -> Program:
    """A ``.mod`` file. Raises InputError for a chain that RAPID has no axes for."""
    module, robot = identifier(name), cell.robot
    external = robot.dof - _ARM
    turning = ~robot.prismatic[:_ARM]
    if not 0 <= external <= _ARM or not turning.all():
        slides = next((j for j, p in zip(robot.joints, robot.prismatic, strict=True) if p), "")
        found = f"{robot.dof} joints" + (f", {slides} slides" if slides else "")
        raise InputError(
            "RAPID",
            "",
            f"needs six joints that turn, and external ones after them; this chain has {found}",
            "begin the chain at the arm, or take the joint angles from the plan",
        )
    axes = [f"axis {k + 1}" for k in range(_ARM)] + [f"eax_{c}" for c in "abcdef"[:external]]
    lines = [
        f"MODULE {module}",
        *(f"  ! {line}" for line in (*head, *head_lines(cell, axes))),
        "  ! An arm with a linkage (IRB 2400, 4400, 6640 ..) counts axis 3 from the horizontal, a",
        "  ! chain from the link before: compare one pose by eye before anything else.",
        f"  ! Speed {_SPEED}: run it first in manual mode with reduced speed, step by step.",
        "  PROC main()",
    ]
    for number, stop in enumerate(stops, start=1):
        lines.append(f"    ! {number} of {len(stops)}: pose {stop.name}")
        lines += _waits(stop.before) if stop.before else []
        for shown in np.where(robot.prismatic, stop.drives * 1e3, np.degrees(stop.drives)):
            values = [f"{value + 0.0:.6f}" for value in shown]
            values += [_UNUSED] * (2 * _ARM - len(values))
            target = f"[[{','.join(values[:_ARM])}],[{','.join(values[_ARM:])}]]"
            lines.append(f"    MoveAbsJ {target}\\NoEOffs,{_SPEED},fine,tool0;")
        lines.append(f"    WaitTime \\InPos,{cell.pace.settle:g};")
        for task in stop.tasks:
            lines += _waits(task)
    return Program("\n".join([*lines, "  ENDPROC", "ENDMODULE", ""]))


def identifier(text: str) -> str:
    """A RAPID name: at most 32 letters, digits and ``_``, a prefix that no keyword has.

    >>> identifier("plan-2")
    'posecal_plan_2'
    """
    return ("posecal_" + re.sub(r"[^A-Za-z0-9_]", "_", text))[:_LONGEST_NAME]


def _waits(task: str) -> list[str]:
    """The program says what is to be done, and stops."""
    return [f"    ! {task}", f'    TPWrite "{_shown(task)}";', "    Stop;"]


def _shown(task: str) -> str:
    return task if len(task) <= _LONGEST_TEXT else f"{task[: _LONGEST_TEXT - 3]}..."
