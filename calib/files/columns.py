"""What the columns of the tables mean: joints, loads and covariates, with their units."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.arm.mimic import Mimic
from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.errors import InputError
from calib.files.csv_table import CsvTable

_CLOCK = "time_s counts seconds: divide milliseconds since 1970 by 1000"
UNITS = {
    "length": {"mm": 1e-3, "m": 1.0},
    "angle": {"deg": math.pi / 180.0, "rad": 1.0},
    "pixel": {"px": 1.0},
    "ratio": {"": 1.0},
}
"""Of every quantity that a table may hold, and their sizes in SI; the first one is written."""
ANGLES, LENGTHS = UNITS["angle"], UNITS["length"]
TORQUES = ("N", "Nm")  # of a joint that slides, or turns
WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
SIGMAS = {"sigma_mm": ("mm", 1e-3), "sigma_px": ("px", 1.0)}
"""Standard deviations of single rows: unit of the numbers that they are of, and its size."""
OTHERS = (
    "pose",
    "marker",
    "instrument",
    "station",
    "session",
    "temperature_degC",
    "time_s",
    "order",
    *SIGMAS,
    "level",
    "weight",
)

_STRUCK = {"load_block": "take it out: the load is changed at each pose"}
"""Columns that there are no more, and what to do."""
_MOST_TURNS = 100.0
_ALIKE = 0.8  # of names that may be meant for each other
_SLACK = (1e-3, math.radians(0.05))
"""By how much a reading may pass a limit, m and rad: controllers stop there, and encoders scatter."""
_RADIANS_LOOK = 2 * math.pi + 0.1  # a whole table of degrees below this is probably radians


@dataclass(frozen=True)
class JointColumn:
    """Where a table tells a joint: ``q = factor * scale * number + offset``.

    name : str, of the column: the joint's own, or its master's; scale : float, SI per unit
    """

    name: str
    scale: float
    factor: float = 1.0
    offset: float = 0.0

    def joint(self, numbers: Array) -> Array:
        """Values of the joint, rad or m, where the column holds these numbers."""
        return self.factor * (numbers * self.scale) + self.offset

    def numbers(self, q: Array) -> Array:
        """What the column holds where the joint is at q, rad or m."""
        return (q - self.offset) / self.factor / self.scale


def joint_columns(path: Path, robot: Robot, columns: tuple[str, ...]) -> list[JointColumn | None]:
    """Where each joint is told. Raises InputError where a column is missing or has no unit.

    A joint that mimics another may have a column of its own, else its master's tells it. So may one
    that others move together; None where it has none, as they tell it.
    """
    found: list[JointColumn | None] = []
    for sources in robot.sources:
        named = [_column_of(path, source, columns) for source in sources]
        own = next((column for column in named if column is not None), None)
        if own is None and sources[0].joint not in robot.undriven:
            joint, *masters = sources
            _refuse_other_unit(path, joint, columns)
            missing = f"no column for joint {joint.joint}"
            missing += "".join(f", nor for {m.master}, which it mimics" for m in masters)
            wanted = " or ".join(name for source in sources[::-1] for name in _named(source))
            raise InputError(path, "line 1", missing, f"add {wanted}")
        found.append(own)
    return found


def _refuse_other_unit(path: Path, source: Mimic, columns: tuple[str, ...]) -> None:
    """Raises InputError for degrees of a joint that slides, and lengths of one that turns."""
    joint, others = source.master, ANGLES if source.slides else LENGTHS
    wrong = next((f"{joint}_{unit}" for unit in others if f"{joint}_{unit}" in columns), None)
    if wrong is not None:
        does = "slides" if source.slides else "turns"
        what = f"column {wrong!r} is no unit of joint {joint}, which {does}"
        raise InputError(path, "line 1", what, f"name it {' or '.join(_named(source))}")


def _named(source: Mimic) -> dict[str, float]:
    """Columns that tell a joint, and SI per unit."""
    units = LENGTHS if source.slides else ANGLES
    return {f"{source.master}_{unit}": scale for unit, scale in units.items()}


def _column_of(path: Path, source: Mimic, columns: tuple[str, ...]) -> JointColumn | None:
    """The column that tells a joint; None where there is none. Raises InputError."""
    named, joint = _named(source), source.master
    present = [name for name in named if name in columns]
    if len(present) > 1:
        raise InputError(path, "line 1", f"joint {joint} stands in two units", "keep one")
    if not present and joint in columns:
        what = f"column {joint!r} has no unit"
        raise InputError(path, "line 1", what, f"name it {' or '.join(named)}")
    if not present:
        return None
    return JointColumn(present[0], named[present[0]], source.factor, source.offset)


def check_known(
    path: Path, robot: Robot, columns: tuple[str, ...], readings: set[str]
) -> tuple[str, ...]:
    """Warnings about columns that are ignored. Raises InputError for a joint that is not there.

    readings : columns that hold what the instruments read
    """
    joints = dict.fromkeys((*robot.joints, *robot.told))
    known = {*OTHERS, *readings, *shared_columns(robot)}
    ignored = []
    for name in columns:
        if name in _STRUCK:
            raise InputError(path, "line 1", f"column {name!r} is not known", _STRUCK[name])
        unit = name.rpartition("_")[2]
        if name in known or not name:
            continue
        if unit in ("deg", "rad") or name.startswith("approach_"):
            what = f"column {name!r} names no joint of the robot"
            absent = sorted({f"{j}_{unit}" for j in joints} - {*columns})
            alike = {column.casefold(): column for column in absent}
            close = difflib.get_close_matches(name.casefold(), alike, n=1, cutoff=_ALIKE)
            meant = f"did you mean {alike[close[0]]!r}? " if close else ""
            raise InputError(path, "line 1", what, f"{meant}joints are {', '.join(joints)}")
        if name.partition("_")[0] in {c.partition("_")[0] for c in (*WRENCH, *OTHERS)}:
            close = difflib.get_close_matches(name, [*WRENCH, *OTHERS], n=1) or ["?"]
            what = f"column {name!r} has no known unit"
            raise InputError(path, "line 1", what, f"name it {close[0]}")
        if close := difflib.get_close_matches(name, [*OTHERS, *WRENCH], n=1, cutoff=0.8):
            what, remedy = f"column {name!r} is not known", f"did you mean {close[0]!r}?"
            raise InputError(path, "line 1", what, remedy)
        ignored.append(name)
    return (f"{path}: ignored columns: {', '.join(ignored)}",) if ignored else ()


def shared_columns(robot: Robot) -> set[str]:
    """Columns in which all rows of one pose must agree: joints, wrench, time and heat."""
    joints = (*robot.joints, *robot.told)
    shared = {*OTHERS, *WRENCH, *torque_columns(robot), *(f"approach_{j}" for j in joints)}
    units = (*ANGLES, *LENGTHS)
    shared |= {f"{j}_{unit}" for j in joints for unit in units}
    shared |= {f"move_{j}_{unit}" for j in joints for unit in units}
    return shared - {"pose", "marker", "instrument", *SIGMAS}


def torque_columns(robot: Robot) -> tuple[str, ...]:
    """Column of the torque, or force, that the arm measured at each joint."""
    force, torque = TORQUES
    return tuple(
        f"{joint}_{force if slides else torque}"
        for joint, slides in zip(robot.joints, robot.prismatic, strict=True)
    )


def motion_columns(table: CsvTable, robot: Robot) -> tuple[tuple[str, float], ...]:
    """Column of each joint's last move, and its unit in SI; of any unit that the table has."""
    own = []
    for joint, slides in zip(robot.joints, robot.prismatic, strict=True):
        known = LENGTHS if slides else ANGLES
        units = {move_name(joint, unit): scale for unit, scale in known.items()}
        told = [unit for unit in units.items() if unit[0] in table.columns]
        own.append((told or list(units.items()))[0])
    return tuple(own)


def move_name(joint: str, unit: str) -> str:
    """Column of the size of a joint's last move."""
    return f"move_{joint}_{unit}"


def joint_values(table: CsvTable, robot: Robot) -> Array:
    """Joint values of every row, shape (rows, n), rad and m."""
    told = joint_columns(table.path, robot, table.columns)
    none = np.zeros(len(table.rows))
    own = [none if c is None else c.joint(table.numbers(c.name)) for c in told]
    q = np.column_stack(own)
    implied = [column is None for column in told]
    q[:, implied] = robot.tied(q)[:, implied]
    turns = np.abs(q) / (2.0 * math.pi)
    for row, j in np.argwhere((turns > _MOST_TURNS) & ~robot.prismatic)[:1]:
        what = f"is an angle of {turns[row, j]:.0f} turns"
        remedy = (
            "check its unit: counts of an encoder and angles of the motor are none of the joint"
        )
        column = told[j]
        raise table.fault(row, robot.joints[j] if column is None else column.name, what, remedy)
    return q


def joint_warnings(table: CsvTable, robot: Robot, q: Array) -> tuple[str, ...]:
    """What is odd about joint values but may be meant: limits left, degrees that look like radians."""
    warnings = []
    turning = ~robot.prismatic
    in_degrees = [f"{j}_deg" in table.columns for j in np.array(robot.joints)[turning]]
    if turning.any() and all(in_degrees):
        largest = float(np.degrees(np.abs(q[:, turning]).max()))
        if 0.0 < largest < _RADIANS_LOOK and len(table.rows) > 2:
            warnings.append(
                f"{table.path}: joint angles reach only {largest:.3g} degrees: the range looks like "
                "radians; if so, name the columns <joint>_rad"
            )
    margin = np.where(robot.prismatic, *_SLACK)
    outside = (q < robot.limits[:, 0] - margin) | (q > robot.limits[:, 1] + margin)
    for j in np.flatnonzero(outside.any(axis=0)):
        row = int(np.flatnonzero(outside[:, j])[0])
        shown = q[row, j] * 1e3 if robot.prismatic[j] else math.degrees(q[row, j])
        unit = "mm" if robot.prismatic[j] else "deg"
        warnings.append(
            f"{table.path}: line {table.lines[row]}: joint {robot.joints[j]} at {shown:.2f} {unit} is "
            f"outside its limits ({int(outside[:, j].sum())} rows in all); check joint names and units"
        )
    return tuple(warnings)


def covariates(table: CsvTable, robot: Robot, rows: IntArray) -> dict[str, Any]:
    """Optional columns, at one row for each pose."""
    found: dict[str, Any] = {}
    wrench = np.zeros((len(rows), 6))
    for i, name in enumerate(WRENCH):
        if name in table.columns:
            wrench[:, i] = table.numbers(name)[rows]
    found["wrench"] = wrench
    for key, name in (("temperature", "temperature_degC"), ("time", "time_s")):
        if name in table.columns:
            found[key] = table.numbers(name, remedy=_CLOCK if key == "time" else "")[rows]
    driven = [joint not in robot.undriven for joint in robot.joints]
    torques = torque_columns(robot)
    if _every_joint(table, tuple(itertools.compress(torques, driven))):
        found["torque"] = _columns(table, torques, rows)
    own = motion_columns(table, robot)
    if _every_joint(table, tuple(name for name, _ in itertools.compress(own, driven))):
        moved = _columns(table, [name for name, _ in own], rows) * [unit for _, unit in own]
        found["motion"] = np.where(driven, moved, moved @ np.abs(robot.ties.matrix).T)
        found["motion_told"] = True
    # A joint tells itself from which side it came, else its master does.
    sided = [
        next((s for s in own if f"approach_{s.master}" in table.columns), own[-1])
        for own in robot.sources
    ]
    signs = tuple(f"approach_{source.master}" for source in sided)
    if _every_joint(table, tuple(itertools.compress(signs, driven))):
        approach = _columns(table, signs, np.arange(len(table.rows)))
        bad = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))
        if len(bad):
            raise table.fault(int(bad[0, 0]), signs[int(bad[0, 1])], "is not -1, 0 or +1")
        found["approach"] = approach[rows] * np.sign([source.factor for source in sided])
    if "session" in table.columns:
        found["session"] = np.array(table.names("session"))[rows]
    if "station" in table.columns:
        names = table.names("station")
        stations = tuple(sorted(set(names)))
        found["stations"] = stations
        found["station"] = np.array([stations.index(names[row]) for row in rows])
    return found


def _columns(table: CsvTable, names: Sequence[str], rows: IntArray) -> Array:
    """Numbers of columns side by side, (rows, n); zeros for those that are not there."""
    none = np.zeros(len(rows))
    own = [table.numbers(name)[rows] if name in table.columns else none for name in names]
    return np.column_stack(own)


def _every_joint(table: CsvTable, names: tuple[str, ...]) -> bool:
    """Whether the columns of all joints are there. Raises InputError where only some are."""
    present = [name for name in names if name in table.columns]
    if present and len(present) < len(names):
        missing = next(name for name in names if name not in present)
        what = f"column {missing!r} is missing beside {present[0]!r}"
        raise InputError(table.path, "line 1", what, "give every joint's, or none")
    return bool(present)
