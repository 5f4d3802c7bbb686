"""Write the CSV tables that ``calib.files.tables`` reads, and corrected commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.arm.robot import Robot
from calib.arm.statics import wrench_with_load
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import InputError
from calib.files.columns import WRENCH, joint_columns, torque_columns
from calib.files.csv_table import CsvTable, columns_text, read_table
from calib.files.readings import written_columns
from calib.instruments import Instrument
from calib.poses import Measurements, Poses

if TYPE_CHECKING:
    from calib.prediction.compensate import Compensation

_CHANGE = "change"


def joint_header(robot: Robot, q: Array | None = None) -> list[str]:
    """Columns that give the joints: of all but those that others move.

    q : ndarray, shape (m, n), values to be given; where some do not follow, every joint has its own
    """
    left = robot.undriven if q is None or robot.follows(q) else ()
    each = zip(robot.joints, robot.prismatic, strict=True)
    return [f"{name}_{'mm' if slides else 'deg'}" for name, slides in each if name not in left]


def _joint_texts(robot: Robot, q: Array) -> dict[str, list[str]]:
    """Numbers of each of these columns, of joint values (m, n)."""
    each = zip(joint_columns(Path(), robot, tuple(joint_header(robot, q))), q.T, strict=True)
    return {c.name: _numbers(own / c.scale) for c, own in each if c is not None}


def _numbers(values: Array, form: str = ".9g") -> list[str]:
    return [f"{value + 0.0:{form}}" for value in values]  # no "-0" of a joint at its end


def measurement_columns(
    robot: Robot, instruments: Sequence[Instrument], q: Array | None = None
) -> list[str]:
    """Columns that every table of these instruments' readings has.

    q : ndarray, shape (m, n), as for :func:`joint_header`
    """
    several = ["instrument"] if len([n for i in instruments for n in i.names]) > 1 else []
    columns = dict(c for instrument in instruments for c in written_columns(instrument))
    return ["pose", "marker", *several, *joint_header(robot, q), *columns]


def measurements_csv(cell: Cell, data: Measurements) -> str:
    """The text of ``measurements.csv``: a row for each reading, with all that is known of it.

    A load hung on the tip is written as the wrench that it exerts at the nominal pose.
    """
    poses = data.poses
    wrench = wrench_with_load(cell.robot, cell.gravity, poses)
    read_by = [i for i, part in cell.channels.blocks for _ in range(part.start, part.stop)]
    pose, channel = (part.tolist() for part in np.nonzero(data.seen))
    sites = [""] * len(poses) if poses.site is None else poses.site.tolist()
    table = {"pose": list(poses.names), **_joint_texts(cell.robot, poses.q)}
    if wrench.any():
        table |= {name: _numbers(own, ".6f") for name, own in zip(WRENCH, wrench.T, strict=True)}
    table |= _session(cell, poses)
    shown = [
        {"marker": cell.channel_names[c], "instrument": read_by[c].name_at(sites[i])}
        | _reading_texts(read_by[c], data.readings[i, c])
        for i, c in zip(pose, channel, strict=True)
    ]
    header = measurement_columns(cell.robot, cell.instruments, poses.q)
    return columns_text(
        {
            name: [table[name][i] for i in pose]
            if name in table
            else [texts.get(name, "") for texts in shown]
            for name in dict.fromkeys((*header, *table))
        }
    )


def _reading_texts(instrument: Instrument, numbers: Array) -> dict[str, str]:
    """A row of an instrument by its columns."""
    entries = instrument.entries_of(numbers[: instrument.rows])
    digits = (5 if column.quantity == "length" else 9 for column in instrument.columns)
    each = zip(written_columns(instrument), entries, digits, strict=True)
    return {name: f"{value / scale:.{places}f}" for (name, scale), value, places in each}


def _session(cell: Cell, poses: Poses) -> dict[str, list[str]]:
    """Columns of temperature, time, torques, sides, station and session, where poses have them."""
    robot, columns = cell.robot, dict[str, list[str]]()
    if poses.temperature is not None:
        columns["temperature_degC"] = _numbers(poses.temperature, ".6g")
    if poses.time is not None:
        columns["time_s"] = _numbers(poses.time)
    if poses.torque is not None:
        each = zip(torque_columns(robot), poses.torque.T, strict=True)
        columns |= {name: _numbers(own) for name, own in each}
    if poses.approach is not None and not poses.approach_derived:
        signs = zip(robot.joints, poses.approach.T, strict=True)
        columns |= {f"approach_{joint}": _numbers(own, ".0f") for joint, own in signs}
    if len(poses.stations) > 1:
        columns["station"] = [poses.stations[i] for i in poses.station]
    if poses.session is not None:
        columns["session"] = poses.session.tolist()
    return columns


def plan_csv(cell: Cell, poses: Poses, level: Array | None = None) -> str:
    """The text of a plan: poses in their order, joints, when each is measured and how it is approached.

    level : ndarray, shape (m,), in degrees or mm where there are levels
    """
    columns = {"pose": list(poses.names), **_joint_texts(cell.robot, poses.q)}
    if level is not None and np.isfinite(level).any():
        columns["level"] = [f"{own:.9g}" for own in level]
    columns["order"] = [f"{number}" for number in range(1, len(poses) + 1)]
    return columns_text(columns | _session(cell, poses))


def commanded_csv(cell: Cell, runs: Sequence[tuple[str, Array, Array, float]]) -> str:
    """The text of motions to be run: session, time, joints, and the mass that is carried.

    runs : of each its session, time (m,) in s, joint values (m, n) and payload in kg
    """
    columns: dict[str, list[str]] = {}
    for session, time, q, payload in runs:
        own = {"session": [session] * len(time), "time_s": _numbers(time)}
        own |= _joint_texts(cell.robot, q)
        own["payload_kg"] = [f"{payload:.9g}"] * len(time)
        for name, texts in own.items():
            columns.setdefault(name, []).extend(texts)
    return columns_text(columns)


def nominal_table(cell: Cell, path: Path) -> CsvTable:
    """The table of targets as text. Raises InputError, also for one that was corrected before."""
    marks = tuple(f"{_CHANGE}_{joint}_" for joint in cell.robot.joints)

    def check(columns: tuple[str, ...]) -> None:
        if any(name.startswith(marks) for name in columns):
            remedy = "give the nominal targets, or take out the columns of changes"
            raise InputError(path, "line 1", "holds corrected commands already", remedy)

    return read_table(path, (), check)


def compensated_csv(cell: Cell, table: CsvTable, found: Compensation) -> str:
    """The targets' own table with corrected joints, in its own units, and columns for what changed.

    table : CsvTable, the targets that were compensated
    """
    named = zip(joint_columns(table.path, cell.robot, table.columns), found.q.T, strict=True)
    joints = {c.name: [f"{value:.9g}" for value in q / c.scale] for c, q in named if c is not None}
    columns = {"pose": list(found.targets.names), **joints}
    columns |= {name: joints.get(name) or table.text(name) for name in table.columns}
    changed = zip(cell.robot.joints, cell.robot.prismatic, found.correction.T, strict=True)
    for joint, slides, change in changed:
        unit, scale = ("um", 1e-6) if slides else ("mdeg", math.pi / 180e3)
        columns[f"{_CHANGE}_{joint}_{unit}"] = [f"{value / scale:.3f}" for value in change]
    for name in ("before", "left", "expected"):
        columns[f"{name}_mm"] = [f"{value * 1e3:.5f}" for value in getattr(found, name)]
    return columns_text(columns | {"limited_by": list(found.limited_by)})
