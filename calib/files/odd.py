"""What is odd about a cell and its data: another unit, numbers that do nothing, or what stands twice.

Each is one line: where, what, and what to do. An instrument repeats each digit only by chance. Where
the digits are finer than its noise, that chance is known, and what is far below it was not measured
anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.arm.statics import wrench_with_load
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.cell.cell import odd_markers, odd_noise
from calib.effects import catalogue
from calib.effects.protocol import ElasticEffect
from calib.errors import InputError
from calib.files.columns import units_of
from calib.files.csv_table import CsvTable
from calib.files.readings import reading_columns
from calib.instruments import Tracker
from calib.poses import Measurements, Poses, hung

_SLACK = (1e-3, math.radians(0.05))
"""By how much a reading may pass a limit, m and rad: controllers stop there, and encoders scatter."""
_RADIANS = 2.0 * math.pi + 0.1  # a whole table of degrees below this is probably radians
_LEAST_ROWS = 3
_STEP = 0.1  # deg, to which some controllers' displays round
_COARSER = 10.0  # times the instrument's noise, by which rounded joints move the tip
_SAME = 0.01  # of the weight
_QUIETER = 10.0  # times less noise than stated: cells state limits, and repeats share errors
_CHANCE = 1e-6  # that an honest table is called copied
_SHOWN = 4
_APART, _DAY = 3600.0, 86400.0  # s, of most readings and of all: milliseconds, probably


def odd_cell(cell: Cell) -> Iterator[str]:
    """Noise and markers that look like another unit's."""
    for instrument in cell.instruments:
        if text := odd_noise(instrument):
            yield f"{cell.path}: {instrument.name}: {text}"
    single = [cell.marker_names.index(name) for name in cell.single_markers]
    if text := odd_markers(cell.markers[single]):
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


# -- what stands twice: the payload's weight, or readings copied to the last digit


def refuse_payload_and_wrench(cell: Cell, path: Path, poses: Poses) -> None:
    """Refuse readings that bear the cell's payload as their wrench. Raises InputError."""
    loaded, payload = poses.take(poses.wrench.any(axis=1)), cell.payload
    if not payload.mass or payload.frame != cell.robot.loaded or not len(loaded):
        return
    free = hung(replace(loaded, wrench=np.zeros_like(loaded.wrench)), payload.mass, payload.com)
    weight = wrench_with_load(cell.robot, cell.gravity, free)
    off, size = ((a[:, :3], a[:, 3:]) for a in (loaded.wrench - weight, weight))
    force, moment = (
        bool((np.linalg.norm(a, axis=1) <= _SAME * np.linalg.norm(b, axis=1)).all())
        for a, b in zip(off, size, strict=True)
    )
    if force and (moment or not loaded.wrench[:, 3:].any()):
        what = f"hold the weight of the cell's [payload], {payload.mass:g} kg, once more"
        remedy = "take [payload] out of the cell, or these columns out of the table"
        where = "columns of the wrench"
        raise InputError(path, where, what, f"a load counts once: {remedy}")


def without_copies(table: CsvTable, cell: Cell, data: Measurements, path: Path) -> Measurements:
    """The measurements without poses that are copies of others, with a warning of each kind.

    A pose whose joints, load and points are all those of an earlier pose is left out: it tells nothing
    new, and would make the arm look as if it never scattered. One whose points alone are those of
    another stays, as nobody knows which of both is right, and is named.
    """
    instrument = cell.instruments[0]
    if len(cell.instruments) != 1 or not isinstance(instrument, Tracker):
        return data
    pairs, alike = _same(data)
    if not len(pairs):
        return data
    chance = _by_chance(table, instrument, data)[pairs[:, 1]]
    unlikely = chance * len(data) ** 2 < _CHANCE
    stuck, copied = pairs[~alike & unlikely], pairs[alike & unlikely]
    warnings = [*data.warnings]
    if len(stuck):
        warnings.append(
            f"{path}: the points of {_named(data, stuck)} are equal to the last digit, but the "
            "joints are not: the instrument stuck, or rows were copied; measure these poses again"
        )
    if len(copied):
        warnings.append(
            f"{path}: {_named(data, copied)} are equal to the last digit: copies, and the "
            "second of each is left out; give only what was measured"
        )
    kept = ~np.isin(np.arange(len(data)), copied[:, 1])
    return replace(data.take(kept), warnings=tuple(warnings))


def _named(data: Measurements, pairs: IntArray) -> str:
    names = [" and ".join(data.poses.names[i] for i in pair) for pair in pairs.tolist()]
    more = f" .. ({len(names)} in all)" if names[_SHOWN:] else ""
    return ", ".join(names[:_SHOWN]) + more


def _same(data: Measurements) -> tuple[IntArray, Mask]:
    """Readings whose points are those of an earlier one, bit for bit.

    Returns the earlier and the later pose, shape (k, 2), and whether their joints are equal too, (k,).
    """
    poses, first = data.poses, dict[tuple[int, bytes, bytes], int]()
    stated = [] if poses.approach is None or poses.approach_derived else [poses.approach]
    pairs, alike = [], []
    for i in np.flatnonzero(data.seen.any(axis=1)).tolist():
        points = (int(poses.station[i]), data.seen[i].tobytes(), data.readings[i].tobytes())
        j = first.setdefault(points, i)
        if j != i:
            pairs.append((j, i))
            fields = (poses.q, poses.wrench, *stated)
            alike.append(all(np.array_equal(a[i], a[j]) for a in fields))
    return np.array(pairs, dtype=int).reshape(-1, 2), np.array(alike, dtype=bool)


def _by_chance(table: CsvTable, instrument: Tracker, data: Measurements) -> Array:
    """Probability, shape (m,), that a reading repeats every digit of another at the same place.

    Of one coordinate with the noise s, shown in steps of d, that is d / (2 sqrt(pi) s), 1 at most.
    """
    steps = []
    for name, scale in reading_columns(table.path, instrument, table.columns):
        texts = (text.lower().partition("e")[0].partition(".")[2] for text in table.text(name))
        decimals = max(len(text.rstrip("0")) for text in texts)  # zeros at the end say nothing
        steps.append(10.0**-decimals * scale)
    stated = np.where(np.isfinite(data.sigma), data.sigma, instrument.noise.along)
    share = np.array(steps) / (2.0 * np.sqrt(np.pi) * stated[..., None] / _QUIETER)
    each = np.where(data.seen[..., None], np.minimum(share, 1.0), 1.0)
    return np.asarray(each.prod(axis=(1, 2)))
