"""What is odd about a cell and its data, but may be meant: another unit, or numbers that do nothing.

Each is one line: where, what, and what to do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.cell import odd_markers, odd_noise
from calib.effects import catalogue
from calib.effects.protocol import ElasticEffect
from calib.errors import InputError
from calib.files.columns import units_of
from calib.files.csv_table import CsvTable
from calib.poses import Poses

_SLACK = (1e-3, math.radians(0.05))
"""By how much a reading may pass a limit, m and rad: controllers stop there, and encoders scatter."""
_RADIANS = 2.0 * math.pi + 0.1  # a whole table of degrees below this is probably radians
_LEAST_ROWS = 3
_STEP = 0.1  # deg, to which some controllers' displays round
_COARSER = 10.0  # times the instrument's noise, by which rounded joints move the tip
_APART, _DAY = 3600.0, 86400.0  # s, of most readings and of all: milliseconds, probably


def odd_cell(cell: Cell) -> Iterator[str]:
    """Noise and markers that look like another unit's."""
    for instrument in cell.instruments:
        if text := odd_noise(instrument):
            yield f"{cell.path}: {instrument.name}: {text}"
    if text := odd_markers(cell.markers[list(cell.single_markers)]):
        yield f"{cell.path}: markers_mm: {text}"


def odd_readings(path: Path, cell: Cell, poses: Poses) -> Iterator[str]:
    """Times that look like milliseconds, and loads that nothing in the model feels, or that lack."""
    if poses.time is not None and len(poses) >= _LEAST_ROWS:
        times = np.unique(poses.time)
        gap, day = float(np.median(np.diff(times, prepend=times[:1]))), np.ptp(times)
        if gap > _APART and day > _DAY:
            yield (
                f"{path}: time_s: most readings are {gap / 3600:.1f} h apart, all of them "
                f"{day / 3600:.0f} h: if these are milliseconds, divide by 1000"
            )
    names = {entry.partition(":")[0].strip() for entry in cell.effects}
    elastic = [n for n in names & catalogue().keys() if issubclass(catalogue()[n], ElasticEffect)]
    if poses.wrench.any() and not elastic:
        yield (
            f"{path}: fx_N .. mz_Nm: nothing in [model] effects yields to this wrench, so that it "
            "does nothing: add joint_compliance, or see what posecal diagnose finds"
        )
    repeats = poses.configuration.max(initial=-1) + 1 < len(poses)
    if cell.load is not None and not poses.wrench.any() and repeats:
        yield (
            f"{path}: no reading bears a load, though joints repeat and the cell has a [load]; that "
            "one is for plans: readings under load need columns fx_N .. mz_Nm"
        )


def odd_joints(table: CsvTable, cell: Cell, q: Array) -> Iterator[str]:
    """Degrees that look like radians or were rounded, and limits that are left; q (rows, n)."""
    robot = cell.robot
    turning = _in_degrees(table, robot)
    if largest := _like_radians(table, robot, q):
        yield (
            f"{table.path}: joint angles reach only {largest:.3g} degrees: the range looks like "
            "radians; if so, name the columns <joint>_rad"
        )
    shown = np.degrees(q[:, turning])
    off = robot.reach * math.radians(_STEP) / math.sqrt(12.0)
    sigma = cell.noise.along if cell.tracker in cell.instruments else math.inf
    if off > _COARSER * sigma and _all_on(shown, _STEP) and not _all_on(shown, 10.0 * _STEP, 0.5):
        yield (
            f"{table.path}: joint angles are rounded to {_STEP:g} deg, which moves the tip by "
            f"{off * 1e3:.2g} mm: write all digits that the controller has"
        )
    margin = np.where(robot.prismatic, *_SLACK)
    outside = (q < robot.limits[:, 0] - margin) | (q > robot.limits[:, 1] + margin)
    for j in np.flatnonzero(outside.any(axis=0)):
        row = int(np.flatnonzero(outside[:, j])[0])
        unit, scale = next(iter(units_of(robot.prismatic[j]).items()))
        at = f"joint {robot.joints[j]} at {q[row, j] / scale:.2f} {unit}"
        yield (
            f"{table.path}: line {table.lines[row]}: {at} is outside its limits "
            f"({int(outside[:, j].sum())} rows in all); check joint names and units"
        )


def refuse_radians(table: CsvTable, robot: Robot, q: Array) -> None:
    """Refuse a plan or targets (rows, n) whose degrees look like radians. Raises InputError."""
    if largest := _like_radians(table, robot, q):
        what = f"joint angles reach only {largest:.3g} degrees, which looks like radians"
        remedy = "name the columns <joint>_rad; write small angles in radians, too"
        raise InputError(table.path, "line 1", what, remedy)


def _in_degrees(table: CsvTable, robot: Robot) -> Mask:
    """Joints that turn, where the table gives all of these in degrees; else none."""
    turning = ~robot.prismatic
    every = all(f"{j}_deg" in table.columns for j in np.array(robot.joints)[turning])
    return np.asarray(turning & every)


def _like_radians(table: CsvTable, robot: Robot, q: Array) -> float:
    """The largest angle, deg, of a table that looks like radians; else zero."""
    turning = _in_degrees(table, robot)
    largest = float(np.degrees(np.abs(q[:, turning])).max(initial=0.0))
    return largest if largest < _RADIANS and len(q) >= _LEAST_ROWS else 0.0


def _all_on(values: Array, step: float, share: float = 1.0) -> bool:
    """Whether so many of some values, not all of them equal, are whole steps."""
    whole = np.abs(values / step - np.round(values / step)) < 1e-6
    return bool(values.size and np.ptp(values) > 0.0 and whole.mean() >= share)
