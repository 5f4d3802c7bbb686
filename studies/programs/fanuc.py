"""Listing of a FANUC TP program: J motions to joint positions in degrees, mm for axes that slide."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calib import Cell
from calib.arrays import Array
from calib.errors import InputError
from studies.programs.stops import Program, Stop, head_lines

_LONGEST_NAME = 32
_LONGEST_REMARK = 32  # characters that the pendant shows of a remark
_MOST_AXES = 9  # of one group
_NOTES = (
    "FANUC counts J3 from the horizontal: where the chain counts it from the link before, "
    "J3 = q3 - q2 in the controller's senses of rotation. Here stand the chain's values.",
)


def fanuc(name: str, cell: Cell, stops: Sequence[Stop], head: Sequence[str]) -> Program:
    """A ``.ls`` file. Raises InputError for a chain of more axes than a group has."""
    program, robot = identifier(name), cell.robot
    if robot.dof > _MOST_AXES:
        raise InputError(
            "FANUC LS", "", f"a group has at most {_MOST_AXES} axes; this chain has {robot.dof}",
            "begin the chain at the arm",
        )  # fmt: skip
    axes = tuple(f"J{k + 1}" for k in range(robot.dof))
    percent = max(1, round(100.0 * cell.pace.speed))
    slow = f"Speed is {percent} %; run it first in T1, step by step."
    notes = [*head, *head_lines(cell, axes), *_NOTES, slow]
    lines = [f"!{piece}" for note in notes for piece in _pieces(note)]
    points: list[Array] = []
    for number, stop in enumerate(stops, start=1):
        lines.append(f"!{_cut(f'{number}/{len(stops)} {stop.name}')}")
        lines += _waits(stop.before) if stop.before else []
        for q in stop.drives:
            points.append(q)
            lines.append(f"J P[{len(points)}] {percent}% FINE")
        lines.append(f"WAIT {cell.pace.settle:6.2f}(sec)")
        lines += [line for task in stop.tasks for line in _waits(task)]
    numbered = [f"{n:4d}:{'' if own[0] == 'J' else '  '}{own} ;" for n, own in enumerate(lines, 1)]
    text = [
        f"/PROG  {program}",
        "/ATTR",
        'COMMENT = "posecal";',
        "PROTECT = READ_WRITE;",
        "DEFAULT_GROUP = 1,*,*,*,*;",
        "/MN",
        *numbered,
        "/POS",
        *(line for n, q in enumerate(points, 1) for line in _position(cell, n, q)),
        "/END",
        "",
    ]
    renamed = (f"the program is {program}: name its file {program}.ls",)
    return Program("\n".join(text), () if program == name.upper() else renamed)


def identifier(text: str) -> str:
    """A program's name: at most 32 capitals, digits and ``_``, a letter first.

    >>> identifier("plan"), identifier("2nd plan")
    ('PLAN', 'P_2ND_PLAN')
    """
    name = re.sub(r"[^A-Z0-9_]", "_", text.upper())
    return (name if name[:1].isalpha() else f"P_{name}")[:_LONGEST_NAME]


def _waits(task: str) -> list[str]:
    """The program says what is to be done, and pauses."""
    return [*(f"!{piece}" for piece in _pieces(task)), "PAUSE"]


def _position(cell: Cell, number: int, q: Array) -> list[str]:
    shown = np.where(cell.robot.prismatic, q * 1e3, np.degrees(q))
    units = np.where(cell.robot.prismatic, "mm", "deg")
    values = [
        f"J{k + 1}= {v + 0.0:.6f} {u}" for k, (v, u) in enumerate(zip(shown, units, strict=True))
    ]
    return [
        f"P[{number}]{{",
        "   GP1:",
        "    UF : 0, UT : 1,",
        *(f"    {value}{',' if k < len(values) - 1 else ''}" for k, value in enumerate(values)),
        "};",
    ]


def _pieces(text: str) -> list[str]:
    """The text in remarks as wide as the pendant, broken at blanks where there are any."""
    pieces = [""]
    for word in text.replace(";", ",").split():
        for part in re.findall(f".{{1,{_LONGEST_REMARK}}}", word):
            joined = f"{pieces[-1]} {part}".strip()
            pieces = [*pieces[:-1], joined] if len(joined) <= _LONGEST_REMARK else [*pieces, part]
    return [piece for piece in pieces if piece]


def _cut(text: str) -> str:
    return text.replace(";", ",")[:_LONGEST_REMARK]
