"""Joint values in exports: tables with a header, KUKA's lists of axes, joint states of MoveIt.

KUKA controllers write ``P001 {A1 10.0, A2 -90.0, ..}``: A1 to A6 are degrees; external axes turn or
slide, so that E1 to E6 carry no unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.arm.robot import Robot
from calib.errors import InputError
from calib.files.columns import ANGLES, LENGTHS, OTHERS, TORQUES, WRENCH
from calib.files.csv_table import CsvTable
from calib.files.exports.hand_eye import YAML, joint_states
from calib.files.exports.sheet import ExportTable, made_sheet, read_sheet, text_lines
from calib.files.readings import reading_names
from calib.instruments import TRACKER

_AXIS = re.compile(r"([AE][1-6])\s+([+-]?[\d.]+(?:[eE][+-]?\d+)?)", re.ASCII)
_LIST = rf"\{{?\s*{_AXIS.pattern}(?:\s*,\s*{_AXIS.pattern})*\s*\}}?"
_LISTED = re.compile(_LIST)
_DECLARED = re.compile(r"(?:DECL\s+)?(?:GLOBAL\s+)?(?:E6AXIS\s+|AXIS\s+)?")
_AFTER_NAME = " \t=:;,"


def axis_sheet(path: Path, lines: list[tuple[int, str]]) -> ExportTable | None:
    """The list as a sheet with a header, None where a line is of another kind. Raises InputError."""
    rows: list[list[str]] = []
    axes: list[str] | None = None
    for _, line in lines:
        # Where the list begins, in linear time; the end of the line where there is none.
        first = _AXIS.search(line) if "{" not in line else None
        start = line.find("{") if "{" in line else first.start() if first else len(line)
        if _LISTED.fullmatch(line, start) is None:
            return None
        pairs = _AXIS.findall(line, start)
        axes = axes or [axis for axis, _ in pairs]
        if [axis for axis, _ in pairs] != axes:
            return None
        name = _DECLARED.sub("", line[:start], count=1).rstrip(_AFTER_NAME)
        rows.append([name, *(value for _, value in pairs)])
    if axes is None:
        return None
    named = any(row[0] for row in rows)
    titles = [f"{axis}_deg" if axis[0] == "A" else axis for axis in axes]
    header = ["pose", *titles] if named else titles
    rows = rows if named else [row[1:] for row in rows]
    numbers = [number for number, _ in lines]
    return made_sheet(path, [], [header, *rows], [numbers[0], *numbers], ",")


UNITS = (*ANGLES, *LENGTHS)
_POSE = ("pose", "name", "id")
_CARRIED = (*WRENCH, "temperature_degC", "time_s", "station", "session")
_NOT_JOINTS = {*OTHERS, *reading_names([TRACKER])}
_BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*([A-Za-z]+|°)\s*[\])]")


@dataclass(frozen=True)
class JointRow:
    """One pose: its name, "" where the file has none, and its values as text."""

    line: int
    pose: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class JointTable:
    """A file of joint values: columns as ``measurements.csv`` names them, a row for each pose."""

    path: Path
    joints: tuple[str, ...]
    carried: tuple[str, ...]
    rows: list[JointRow]
    ignored: tuple[str, ...]

    @property
    def named(self) -> bool:
        return bool(self.rows[0].pose)


def read_joints(
    path: Path,
    *,
    unit: str | None = None,
    rename: Sequence[str] | None = None,
    robot: Robot | None = None,
) -> JointTable:
    """Read a table with a header, a list ``{A1 10.0, A2 -90.0, ..}`` as KUKA controllers write, or the
    joint states of MoveIt's calibration.

    unit : of joint columns that name none
    rename : names for the joints in the order of their columns
    robot : its joints are the ones looked for; else every column of numbers is taken for one

    Raises InputError.
    """
    if path.suffix.lower() in YAML:
        sheet = joint_states(path)
    else:
        sheet = axis_sheet(path, text_lines(path)) or read_sheet(path)
    if sheet.header is None:
        remedy = "begin with a header, as in pose,A1_deg,A2_deg"
        raise InputError(path, "line 1", "names no columns", remedy)
    titles = [titled(text) for text in sheet.header]
    for title in titles:
        if titles.count(title) > 1:
            raise InputError(path, "header", f"column {title!r} stands twice", "rename one")
    pose = next((titles.index(t) for n in _POSE for t in titles if t.lower() == n), None)
    carried = [i for i, t in enumerate(titles) if t in _CARRIED or _of_a_joint(t, titles)]
    rest = [i for i in range(len(titles)) if i != pose and i not in carried]
    wanted = None if robot is None or rename is not None else (*robot.joints, *robot.told)
    if wanted is None:
        joints = [i for i in rest if titles[i] not in _NOT_JOINTS and sheet.holds_numbers(i)]
    else:
        joints = [i for i in rest if _parted(titles[i])[0] in wanted or titles[i] in wanted]
    names = _joint_names(path, [titles[i] for i in joints], unit, rename, robot)
    texts = [i for i in carried if titles[i] in ("station", "session")]
    rows: dict[str, JointRow] = {}
    for row, line in enumerate(sheet.lines):
        name = "" if pose is None else sheet.rows[row][pose]
        if pose is not None and not name:
            raise sheet.fault(row, "the pose has no name")
        if name and name in rows:
            what = f"pose {name!r} stands in line {rows[name].line} already"
            raise sheet.fault(row, what, "give each reading its own name")
        values = [
            sheet.rows[row][i] if i in texts else sheet.number(row, i) for i in (*joints, *carried)
        ]
        rows[name or str(row)] = JointRow(line, name, tuple(values))
    ignored = tuple(titles[i] for i in rest if i not in joints and titles[i])
    stems = [_parted(titles[i])[0] for i in joints]
    called = dict(zip(stems, (_parted(name)[0] for name in names), strict=True))
    return JointTable(
        path,
        names,
        tuple(_following(titles[i], called) for i in carried),
        list(rows.values()),
        ignored,
    )


def titled(text: str) -> str:
    """``A1 [deg]`` and ``A1 (deg)`` as ``A1_deg``."""
    match = _BRACKETS.fullmatch(text)
    if match is None:
        return text
    return f"{match[1]}_{'deg' if match[2] == '°' else match[2]}"


def _parted(title: str) -> tuple[str, str]:
    """A joint's name and its unit, "" where the title has none."""
    name, _, unit = title.rpartition("_")
    return (name, unit) if name and unit in UNITS else (title, "")


def _of_a_joint(title: str, titles: Sequence[str]) -> bool:
    """Whether a column says more of a joint in the table: from where it came, or its torque."""
    if title.startswith("approach_"):
        return True
    joint, _, unit = title.rpartition("_")
    return unit in TORQUES and any(_parted(t)[0] == joint for t in titles if t != title)


def _following(title: str, called: Mapping[str, str]) -> str:
    """The title of a column of a joint under the joint's new name; any other as it is."""
    if title.startswith("approach_"):
        joint = title.removeprefix("approach_")
        return f"approach_{called.get(joint, joint)}"
    joint, _, unit = title.rpartition("_")
    return f"{called[joint]}_{unit}" if unit in TORQUES and joint in called else title


def _joint_names(
    path: Path,
    titles: Sequence[str],
    unit: str | None,
    rename: Sequence[str] | None,
    robot: Robot | None,
) -> tuple[str, ...]:
    """Names with units, renamed and checked against the robot. Raises InputError."""
    if not titles:
        found = "" if robot is None else f" of {', '.join(robot.told)}"
        remedy = "name columns as A1_deg" if robot is None else _renaming(robot)
        raise InputError(path, "header", f"holds no joint{found}", remedy)
    parted = [_parted(title) for title in titles]
    if rename is not None:
        if len(rename) != len(parted):
            what = f"has {len(parted)} joints ({', '.join(titles)})"
            raise InputError(path, "header", what, f"--joint-names names {len(rename)}")
        parted = [(name, own) for name, (_, own) in zip(rename, parted, strict=True)]
    every = () if robot is None else (own for sources in robot.sources for own in sources)
    slides = {own.master: own.slides for own in every}
    named = []
    for joint, own in parted:
        chosen = own or unit
        misfit = joint in slides and not own and (unit in LENGTHS) != slides[joint]
        if chosen is None or misfit:
            wanted = f"{joint}_mm" if slides.get(joint) else f"{joint}_deg"
            raise InputError(
                path,
                "header",
                f"column {joint!r} has no unit",
                f"if it is a joint, name it {wanted}" + (" or give --unit-joints" * (unit is None)),
            )
        named.append(f"{joint}_{chosen}")
    if robot is not None:
        _check_joints(path, [joint for joint, _ in parted], robot)
    return tuple(named)


def _check_joints(path: Path, joints: Sequence[str], robot: Robot) -> None:
    for sources in robot.sources:
        counts = [joints.count(source.master) for source in sources]
        if not any(counts) or max(counts) > 1:
            what = f"has {'two' if any(counts) else 'no'} columns of joint {sources[0].joint}"
            raise InputError(path, "header", what, _renaming(robot))
    for joint in joints:
        if joint not in (*robot.joints, *robot.told):
            raise InputError(path, "header", f"the robot has no joint {joint}", _renaming(robot))


def _renaming(robot: Robot) -> str:
    return f"rename the columns, or name them in order: --joint-names {','.join(robot.told)}"


def read_whole(path: Path) -> CsvTable:
    """Read a table of measurements or a plan, whatever separates its columns.

    Raises InputError where it is a list of points or joints alone.
    """
    sheet = read_sheet(path)
    columns = tuple(titled(text) for text in sheet.header or ())
    if "pose" not in columns:
        what = "has no column 'pose', as a table of measurements or a plan has"
        raise InputError(path, "header", what, "name it so, or give the joints by --joints FILE")
    rows = [[sheet.pointed(text) for text in row] for row in sheet.rows]
    return CsvTable(path, columns, rows, sheet.lines)


def one_table(tables: Sequence[CsvTable]) -> CsvTable:
    """Tables of the same poses by several instruments, or of several days, as one.

    Raises InputError where they name joints or units differently: nobody could fill the gaps.
    """
    first, *rest = tables
    columns = tuple(dict.fromkeys(name for own in tables for name in own.columns))
    shared = [n for n in first.columns if _parted(n)[1] and n not in _NOT_JOINTS]
    for own in rest:
        missing = [name for name in shared if name not in own.columns]
        if missing:
            what = f"has no column {missing[0]!r}, as {first.path} has"
            raise InputError(own.path, "header", what, "write joints alike in both")
    rows = [
        [own[table.columns.index(name)] if name in table.columns else "" for name in columns]
        for table in tables
        for own in table.rows
    ]
    lines = [line for table in tables for line in table.lines]
    return CsvTable(first.path, columns, rows, lines)
