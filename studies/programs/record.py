"""Robot programs that drive a plan from pose to pose, and what is told of them."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING, Literal

import numpy as np

from calib.errors import InputError
from studies.document import Document, Section, Sentence
from studies.record import Count, Record

if TYPE_CHECKING:
    from calib import Cell
    from calib.poses import Poses

_LINKAGE = "An arm with a linkage counts axis 3 from the horizontal, a chain from the link before."
LANGUAGES = {
    ".src": ("&ACCESS RVP\nDEF {name}()\n{head}\nBAS(#INITMOV,0)\nBAS(#VEL_PTP,{percent})", "; ",
             "PTP {{{named}}}", "WAIT SEC {settle:.1f}\n; {task}\nHALT", "END"),
    ".script": ("def posecal_{name}():\n{head}", "  # ", "  movej([{radians}], a=0.3, v=0.2)",
                '  sleep({settle})\n  popup("{task}", title="posecal", blocking=True)', "end"),
    ".mod": (f"MODULE posecal_{{name}}\n  ! {_LINKAGE}\n{{head}}\n  PROC main()", "  ! ",
             "    MoveAbsJ [[{arm}],[{external}]]\\NoEOffs,v50,fine,tool0;",
             '    WaitTime \\InPos,{settle:g};\n    TPWrite "{task}";\n    Stop;',
             "  ENDPROC\nENDMODULE"),
    ".ls": (f"/PROG  {{name}}\n/ATTR\nDEFAULT_GROUP = 1,*,*,*,*;\n/MN\n!{_LINKAGE}\n{{head}}", "!",
            "J P[{number}] {percent}% FINE", "WAIT {settle:6.2f}(sec)\n!{task}\nPAUSE",
            "/POS\n{positions}\n/END"),
}  # fmt: skip
"""By the file's ending: templates of the head, a remark, a motion, a stop, and the end."""


class ProgramRecord(Record):
    """A plan as a robot program: the file, the poses by their names in it, how often it stops."""

    command: Literal["program"] = "program"
    program: str
    poses: tuple[str, ...]
    stops: Count


def plain_text(text: str) -> str:
    """Letters, digits and harmless signs of a text; all else becomes ``_``, and it is cut short.

    >>> plain_text('p1"); halt()' + chr(10) + 'END')
    'p1_)_ halt()_END'
    """
    return re.sub(r"[^A-Za-z0-9 _.:,=+()@%-]", "_", text)[:75]


def program_text(
    ending: str, name: str, cell: Cell, plan: Poses, source: str, head: list[str]
) -> str:
    """The program that stops at each pose, with the cell's load twice. Raises InputError."""
    robot, load = cell.robot, cell.load
    most = {".script": 6, ".ls": 9}.get(ending, 12)
    if not 6 <= robot.dof <= most or robot.prismatic[:6].any() or robot.mimics or robot.couplings:
        what = f"takes six joints that turn, {most - 6} after them at most, each with a drive"
        raise InputError(ending, "", what, "drive the arm by hand to the values of the plan")
    first, remark, drive, wait, end = LANGUAGES[ending]
    module = re.sub(r"^(?![A-Za-z])", "p_", re.sub(r"[^A-Za-z0-9_]", "_", name))[:24]
    given = {"name": module, "percent": round(100 * cell.pace.speed), "settle": cell.pace.settle}
    lines = [first.format(head="\n".join(remark + plain_text(own) for own in head), **given)]
    tasks = ["measure"] if load is None else ["measure", f"hang {load.mass:g} kg, measure"]
    positions = []
    for number, (pose, q) in enumerate(zip(plan.names, plan.q, strict=True), 1):
        outside = np.abs(q - np.clip(q, *robot.limits.T)) > 1e-4  # rad or m
        for joint in np.array(robot.joints)[outside]:
            what = f"joint {joint} is beyond its limits"
            raise InputError(source, f"pose {plain_text(pose)}", what, "take the pose out")
        values = [f"{v + 0.0:.6f}" for v in np.where(robot.prismatic, 1e3 * q, np.degrees(q))]
        units = [
            f"{own} {'mm' if p else 'deg'}" for own, p in zip(values, robot.prismatic, strict=True)
        ]
        shown = ",\n".join(f"    J{k}= {own}" for k, own in enumerate(units, 1))
        positions.append(f"P[{number}]{{\n   GP1:\n    UF : 0, UT : 1,\n{shown}\n}};")
        named = ",".join(f"{'AE'[k > 5]}{k % 6 + 1} {own}" for k, own in enumerate(values))
        radians = ", ".join(f"{v + 0.0:.9f}" for v in q)
        external = ",".join([*values[6:], *["9E9"] * (12 - robot.dof)])
        lines.append(drive.format(named=named, radians=radians, number=number,
                                  arm=",".join(values[:6]), external=external, **given))  # fmt: skip
        lines += [wait.format(task=plain_text(f"{own} {pose}"), **given) for own in tasks]
    text = "\n".join([*lines, end.format(positions="\n".join(positions)), ""])
    return _numbered(text) if ending == ".ls" else text


def _numbered(text: str) -> str:
    """FANUC's lines between /MN and /POS with their numbers; remarks are as wide as the pendant."""
    above, body, below = re.split(r"(?<=/MN\n)|(?=/POS\n)", text)
    lines: list[str] = []
    for own in filter(None, body.splitlines()):
        parts = [f"!{part}" for part in textwrap.wrap(own[1:], 32)] if own[0] == "!" else [own]
        lines += [part if own[0] == "J" else f"  {part}" for part in parts]
    return above + "".join(f"{n:4d}:{own} ;\n" for n, own in enumerate(lines, 1)) + below


def told(record: ProgramRecord) -> Document:
    """The stops."""
    parts = (Sentence(f"{len(record.poses)} poses, {record.stops} stops to measure"),)
    return Document((), (Section("program", "A robot program of the plan", parts),))
