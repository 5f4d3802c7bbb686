"""Robot programs that drive a plan: one function a language, by the ending of its file.

Axis values are in degrees, mm for axes that slide; URScript takes radians.
"""

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
from doe.day.duration import limits_of, paced
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


Lines = Sequence[str]


def _stops(
    stops: Sequence[Stop],
    title: Callable[[int, Stop], Lines],
    waits: Callable[[str], Lines],
    drive: Callable[[Array], str],
    settle: str,
) -> Iterator[str]:
    """Lines of all stops: to drive there, to settle, and to wait for what is done there.

    title : of a stop by its number; waits : says what is to be done, and pauses; drive : to a point
    """
    for number, stop in enumerate(stops, start=1):
        yield from title(number, stop)
        yield from waits(stop.before) if stop.before else ()
        yield from map(drive, stop.drives)
        yield settle
        for task in stop.tasks:
            yield from waits(task)


def _shown(cell: Cell, q: Array) -> Array:
    """A point (n,) in degrees and mm, without a minus before zero."""
    return np.where(cell.robot.prismatic, q * 1e3, np.degrees(q)) + 0.0


def _percent(cell: Cell) -> int:
    """Share of the joint speeds."""
    return max(1, round(100.0 * cell.pace.speed))


def _plain(text: str) -> str:
    """Letters, digits and ``_``."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)


def _six_that_turn(cell: Cell, language: str, needs: str, external: int, remedy: str) -> None:
    """Raise InputError where the chain has not six joints that turn, and so many more at most."""
    robot, found = cell.robot, f"{cell.robot.dof} joints"
    slides = [j for j, p in zip(robot.joints[:6], robot.prismatic, strict=False) if p]
    if not 0 <= robot.dof - 6 <= external or slides:
        slides = [j for j, p in zip(robot.joints, robot.prismatic, strict=True) if p]
        found += f", {slides[0]} slides" if slides else ""
        raise InputError(language, "", f"{needs} this chain has {found}", remedy)


# -- KUKA Robot Language ------------------------------------------------------------------------

_LONGEST_KRL = 24  # characters of an identifier
_MOST_AXES = 6  # of the arm, and of external ones
_KEYWORDS = (
    " AND ANIN ANOUT B_AND B_EXOR B_NOT B_OR BOOL BRAKE CASE CAST_FROM CAST_TO CCLOSE CHANNEL CHAR "
    "CIRC CIRC_REL CONFIRM CONST CONTINUE COPEN CREAD CWRITE DECL DEF DEFAULT DEFDAT DEFFCT DELAY DO "
    "ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSWITCH ENDWHILE ENUM EXIT EXOR EXT EXTFCT FALSE "
    "FOR FRAME GLOBAL GOTO HALT IF IMPORT INT INTERRUPT IS LIN LIN_REL LOOP NOT OFF ON OR PTP PTP_REL "
    "PUBLIC PULSE REAL REPEAT RESUME RETURN SIGNAL SPLINE SREAD STRUC SWITCH SWRITE THEN TO TRIGGER "
    "TRUE UNTIL WAIT WHEN WHILE "
)


def krl(name: str, cell: Cell, stops: Sequence[Stop], head: Lines) -> Program:
    """A ``.src`` file of PTP motions. Raises InputError for a chain that KRL has no axes for."""
    module, axes, percent = identifier(name), axis_names(cell), _percent(cell)

    def drive(q: Array) -> str:
        values = zip(axes, _shown(cell, q), strict=True)
        return f"PTP {{{','.join(f'{axis} {value:.6f}' for axis, value in values)}}}"

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
        *_stops(
            stops,
            lambda number, stop: ["", f"; {number} of {len(stops)}: pose {stop.name}"],
            lambda task: [f"; {task}", "HALT"],
            drive,
            f"WAIT SEC {cell.pace.settle:.1f}",
        ),
    ]
    notes = (f"the module is {module}: name its file {module}.src",) if module != name else ()
    return Program("\n".join([*lines, "", "END", ""]), notes)


def identifier(text: str) -> str:
    """A KRL name: at most 24 letters, digits and ``_``, no digit first, no keyword.

    >>> identifier("plan"), identifier("2nd plan, free"), identifier("end")
    ('plan', 'p_2nd_plan__free', 'p_end')
    """
    name = _plain(text)
    if not name[:1].isalpha() or f" {name.upper()} " in _KEYWORDS:
        name = f"p_{name}"
    return name[:_LONGEST_KRL]


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
    every = [f"A{k + 1}" for k in range(_MOST_AXES)] + [f"E{k + 1}" for k in range(_MOST_AXES)]
    return tuple(every[: robot.dof])


# -- URScript of Universal Robots ---------------------------------------------------------------

_UR_JOINTS = ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")
_UR_SPEED, _UR_ACCELERATION = 0.2, 0.3  # rad/s and rad/s^2, where the cell knows none


def urscript(name: str, cell: Cell, stops: Sequence[Stop], head: Lines) -> Program:
    """A ``.script`` file of movej. Raises InputError for a chain that is not six joints that turn.

    As the controller wants it: ``def`` and ``end`` in the first column, all between them indented.
    """
    remedy = "take the joint angles from the plan"
    _six_that_turn(cell, "URScript", "needs six joints that turn;", 0, remedy)
    program = f"posecal_{_plain(name)}()"  # no keyword begins so
    speed, acceleration = _UR_SPEED, _UR_ACCELERATION
    if paced(cell):  # what no joint exceeds when it leads the motion, rounded down
        speed, acceleration = (np.floor(1e3 * own.min()) / 1e3 for own in limits_of(cell))
    lines = [
        f"def {program}:",
        *(f"  # {line}" for line in (*head, *head_lines(cell, _UR_JOINTS))),
        f"  # Speed {speed:g} rad/s, acceleration {acceleration:g} rad/s^2; run it slower at first.",
        "  # A popup waits wherever something is to be measured.",
        f"  # Send the file as it is; within a Script node, call {program} after it.",
        *_stops(
            stops,
            lambda number, stop: ["  #", f"  # {number} of {len(stops)}: pose {stop.name}"],
            lambda task: [f'  popup("{task}", title="posecal", blocking=True)'],
            lambda q: (
                f"  movej([{', '.join(f'{value + 0.0:.9f}' for value in q)}], "
                f"a={acceleration:g}, v={speed:g})"
            ),
            f"  sleep({cell.pace.settle})",
        ),
    ]
    return Program("\n".join([*lines, "end", ""]))


# -- RAPID of ABB -------------------------------------------------------------------------------

_LONGEST_RAPID = 32  # characters of an identifier
_UNUSED = "9E9"  # of an external axis
_SPEED = "v50"
_LONGEST_TEXT = 70  # characters of a line on the pendant; a string holds 80


def rapid(name: str, cell: Cell, stops: Sequence[Stop], head: Lines) -> Program:
    """A ``.mod`` file of MoveAbsJ. Raises InputError for a chain that RAPID has no axes for."""
    needs = "needs six joints that turn, and external ones after them;"
    remedy = "begin the chain at the arm, or take the joint angles from the plan"
    _six_that_turn(cell, "RAPID", needs, 6, remedy)
    axes = [*(f"axis {k}" for k in range(1, 7)), *(f"eax_{c}" for c in "abcdef")][: cell.robot.dof]

    def waits(task: str) -> list[str]:
        short = task if len(task) <= _LONGEST_TEXT else f"{task[: _LONGEST_TEXT - 3]}..."
        return [f"    ! {task}", f'    TPWrite "{short}";', "    Stop;"]

    def drive(q: Array) -> str:
        values = [f"{value:.6f}" for value in _shown(cell, q)]
        values += [_UNUSED] * (12 - len(values))
        target = f"[[{','.join(values[:6])}],[{','.join(values[6:])}]]"
        return f"    MoveAbsJ {target}\\NoEOffs,{_SPEED},fine,tool0;"

    lines = [
        f"MODULE {f'posecal_{_plain(name)}'[:_LONGEST_RAPID]}",  # no keyword begins so
        *(f"  ! {line}" for line in (*head, *head_lines(cell, axes))),
        "  ! An arm with a linkage (IRB 2400, 4400, 6640 ..) counts axis 3 from the horizontal, a",
        "  ! chain from the link before: compare one pose by eye before anything else.",
        f"  ! Speed {_SPEED}: run it first in manual mode with reduced speed, step by step.",
        "  PROC main()",
        *_stops(
            stops,
            lambda number, stop: [f"    ! {number} of {len(stops)}: pose {stop.name}"],
            waits,
            drive,
            f"    WaitTime \\InPos,{cell.pace.settle:g};",
        ),
    ]
    return Program("\n".join([*lines, "  ENDPROC", "ENDMODULE", ""]))


# -- listing of a FANUC TP program --------------------------------------------------------------

_LONGEST_TP = 32  # characters of a name, and of a remark that the pendant shows
_MOST_OF_A_GROUP = 9  # axes
_TP_NOTES = (
    "FANUC counts J3 from the horizontal: where the chain counts it from the link before, "
    "J3 = q3 - q2 in the controller's senses of rotation. Here stand the chain's values.",
)


def fanuc(name: str, cell: Cell, stops: Sequence[Stop], head: Lines) -> Program:
    """A ``.ls`` file of J motions. Raises InputError for a chain of more axes than a group has."""
    robot, program = cell.robot, _plain(name).upper()
    program = (program if program[:1].isalpha() else f"P_{program}")[:_LONGEST_TP]
    if robot.dof > _MOST_OF_A_GROUP:
        most = f"a group has at most {_MOST_OF_A_GROUP} axes; this chain has {robot.dof}"
        raise InputError("FANUC LS", "", most, "begin the chain at the arm")
    axes = tuple(f"J{k + 1}" for k in range(robot.dof))
    percent = _percent(cell)
    slow = f"Speed is {percent} %; run it first in T1, step by step."
    points: list[Array] = []

    def drive(q: Array) -> str:
        points.append(q)
        return f"J P[{len(points)}] {percent}% FINE"

    def title(number: int, stop: Stop) -> list[str]:
        return [f"!{f'{number}/{len(stops)} {stop.name}'.replace(';', ',')[:_LONGEST_TP]}"]

    settle = f"WAIT {cell.pace.settle:6.2f}(sec)"
    lines = [
        *(
            own
            for note in (*head, *head_lines(cell, axes), *_TP_NOTES, slow)
            for own in _remarks(note)
        ),
        *_stops(stops, title, lambda task: [*_remarks(task), "PAUSE"], drive, settle),
    ]
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


def _position(cell: Cell, number: int, q: Array) -> list[str]:
    units = np.where(cell.robot.prismatic, "mm", "deg")
    shown = enumerate(zip(_shown(cell, q), units, strict=True), 1)
    values = ",\n".join(f"    J{k}= {value:.6f} {unit}" for k, (value, unit) in shown)
    return [f"P[{number}]{{", "   GP1:", "    UF : 0, UT : 1,", values, "};"]


def _remarks(text: str) -> list[str]:
    """The text in remarks as wide as the pendant, broken at blanks where there are any."""
    pieces = [""]
    for word in text.replace(";", ",").split():
        for part in re.findall(f".{{1,{_LONGEST_TP}}}", word):
            joined = f"{pieces[-1]} {part}".strip()
            pieces = [*pieces[:-1], joined] if len(joined) <= _LONGEST_TP else [*pieces, part]
    return [f"!{piece}" for piece in pieces if piece]


LANGUAGES: dict[str, Language] = {
    ".src": krl,
    ".script": urscript,
    ".mod": rapid,
    ".ls": fanuc,
}
"""The function that writes a program, by the ending of its file."""
