"""KUKA Robot Language: PTP motions to axis values in degrees, mm for axes that slide."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calib import Cell
from calib.errors import InputError
from studies.programs.stops import Program, Stop, head_lines

_LONGEST_NAME = 24  # characters of a KRL identifier
_MOST_AXES = 6  # of the arm, and of external ones
_KEYWORDS = (
    " AND ANIN ANOUT B_AND B_EXOR B_NOT B_OR BOOL BRAKE CASE CAST_FROM CAST_TO CCLOSE CHANNEL CHAR "
    "CIRC CIRC_REL CONFIRM CONST CONTINUE COPEN CREAD CWRITE DECL DEF DEFAULT DEFDAT DEFFCT DELAY DO "
    "ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSWITCH ENDWHILE ENUM EXIT EXOR EXT EXTFCT FALSE "
    "FOR FRAME GLOBAL GOTO HALT IF IMPORT INT INTERRUPT IS LIN LIN_REL LOOP NOT OFF ON OR PTP PTP_REL "
    "PUBLIC PULSE REAL REPEAT RESUME RETURN SIGNAL SPLINE SREAD STRUC SWITCH SWRITE THEN TO TRIGGER "
    "TRUE UNTIL WAIT WHEN WHILE "
)


def krl(name: str, cell: Cell, stops: Sequence[Stop], head: Sequence[str]) -> Program:
    """A ``.src`` file. Raises InputError for a chain that KRL has no axes for."""
    module, robot = identifier(name), cell.robot
    percent = max(1, round(100.0 * cell.pace.speed))
    axes = axis_names(cell)
    lines = [
        "&ACCESS RVP",
        f"DEF {module}()",
        *(f"; {line}" for line in (*head, *head_lines(cell, axes))),
        f"; Speed and acceleration are {percent} % of each axis; run it first in T1, step by step.",
        "; The program waits at every HALT; start it again when what stands above it is done.",
        ";FOLD INI",
        "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM()",
        "INTERRUPT ON 3",
        "BAS(#INITMOV,0)",
        ";ENDFOLD (INI)",
        f"BAS(#VEL_PTP,{percent})",
        f"BAS(#ACC_PTP,{percent})",
    ]
    for number, stop in enumerate(stops, start=1):
        lines += ["", f"; {number} of {len(stops)}: pose {stop.name}"]
        lines += [f"; {stop.before}", "HALT"] if stop.before else []
        for shown in np.where(robot.prismatic, stop.drives * 1e3, np.degrees(stop.drives)):
            target = ",".join(f"{axis} {_fixed(v)}" for axis, v in zip(axes, shown, strict=True))
            lines.append(f"PTP {{{target}}}")
        lines.append(f"WAIT SEC {cell.pace.settle:.1f}")
        for task in stop.tasks:
            lines += [f"; {task}", "HALT"]
    notes = (f"the module is {module}: name its file {module}.src",) if module != name else ()
    return Program("\n".join([*lines, "", "END", ""]), notes)


def identifier(text: str) -> str:
    """A KRL name: at most 24 letters, digits and ``_``, no digit first, no keyword.

    >>> identifier("plan"), identifier("2nd plan, free"), identifier("end")
    ('plan', 'p_2nd_plan__free', 'p_end')
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    if not name[:1].isalpha() or f" {name.upper()} " in _KEYWORDS:
        name = f"p_{name}"
    return name[:_LONGEST_NAME]


def axis_names(cell: Cell) -> tuple[str, ...]:
    """A1 to A6 and E1 to E6, from the joints' names where all end so, else in the chain's order.

    Raises InputError where the order cannot tell which joint is which axis.
    """
    robot = cell.robot
    ends = [re.search(r"(?:^|_)([AaEe][1-6])$", joint) for joint in robot.joints]
    named = [end[1].upper() for end in ends if end is not None]
    if len(set(named)) == robot.dof:
        return tuple(named)
    if robot.dof > 2 * _MOST_AXES or robot.prismatic[:_MOST_AXES].any():
        raise InputError(
            "KRL",
            f"joints {', '.join(robot.joints)}",
            "do not tell which are the axes A1 to A6 and which the external ones E1 to E6",
            f"let the {cell.robot.source}'s names end so, as in joint_a1 or rail_e1",
        )
    arm, external = min(robot.dof, _MOST_AXES), max(robot.dof - _MOST_AXES, 0)
    return tuple([f"A{k + 1}" for k in range(arm)] + [f"E{k + 1}" for k in range(external)])


def _fixed(value: float) -> str:
    return f"{value + 0.0:.6f}"
