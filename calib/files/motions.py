"""Read ``motion.csv``: joint angles and torques, or currents, of runs over time."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.errors import InputError
from calib.files.columns import Column, column_of, joint_columns, torque_columns, units_of
from calib.files.csv_table import CsvTable, columns_of, read_rows
from calib.motion.filtering import SLOW
from calib.motion.motions import Motions, Run, Unit

_LARGEST_FILE = 2_000_000_000  # bytes
_LARGEST_NUMBER = 1e12
_REMEDY = "leave the row out if it was not logged"
_FEWEST = 50  # rows of a run
_CARRIED, _SAME_LOAD = "payload_kg", 1e-3  # kg, or share of a load above one
_BAD_STAMPS = 0.01  # share of a run's rows that may go
_BREAK = 0.5  # s, beyond which a run begins anew
_OTHER_RATE = 1.6  # times: between parts of a run
_UNSIGNED = 2.0 / 3.0  # share of the joints


def holds_motions(path: Path) -> bool:
    """Whether a table holds motions, of whatever units: times and efforts, no markers and poses."""
    names = columns_of(path)
    driven = any(name.endswith(("_Nm", "_mNm", "_N", "_A", "_mA")) for name in names)
    timed = any(name.partition("_")[0] == "time" for name in names)
    return driven and timed and not names & {"marker", "pose", "instrument"}


def load_motions(cell: Cell, path: str | Path) -> Motions:
    """The runs of a table, in SI; currents as torques where the cell states the constants.

    Raises InputError, naming line and column, for what is no table of this robot's motions.
    """
    path, robot = Path(path), cell.robot
    columns, rows = read_rows(path, ("time_s",), lambda _: None, _LARGEST_FILE)
    given = joint_columns(path, robot, columns)
    efforts, unit = _efforts(path, columns, robot)
    behind = [
        column_of(path, columns, f"{j}_link", units_of(s), f"{j}_link")
        for j, s in zip(robot.joints, robot.prismatic.tolist(), strict=True)
    ]
    read = [column.name for column in (*given, *behind) if column is not None]
    wanted = list(dict.fromkeys(["time_s", *read, *efforts, *({_CARRIED} & set(columns))]))
    sessions, lines, numbers = _numbers(path, columns, rows, wanted)
    _refuse_other_loads(path, cell, numbers, lines)
    q = _joint_values(numbers, given, 0.0)
    effort = np.column_stack([numbers[name] for name in efforts])
    if unit == "A" and all(joint in cell.motion.constants for joint in robot.joints):
        effort = effort * [cell.motion.constants[joint] for joint in robot.joints]
        unit = "Nm"
    link = _joint_values(numbers, behind, np.nan) if any(behind) else None
    runs, warnings = list[Run](), list[str]()
    for name in dict.fromkeys(sessions):
        own = np.flatnonzero(np.array(sessions) == name)
        beyond = None if link is None else link[own]
        run = Run(name, numbers["time_s"][own], robot.tied(q[own]), effort[own], beyond)
        found, said = _checked(path, run, lines[own])
        runs += found
        warnings += said
    if not runs:
        raise InputError(path, "", "holds no run in which a joint moves", "log the robot in motion")
    _refuse_unsigned(path, runs)
    return Motions(tuple(runs), unit, tuple(warnings))


def _efforts(path: Path, columns: Sequence[str], robot: Robot) -> tuple[list[str], Unit]:
    """Columns of torque or current of every joint. Raises InputError where one has none."""
    torques, currents = [*torque_columns(robot)], [f"{j}_A" for j in robot.joints]
    kinds: tuple[tuple[list[str], Unit], ...] = (torques, "Nm"), (currents, "A")
    for names, unit in kinds:
        missing = [name for name in names if name not in columns]
        if not missing:
            return names, unit
        if missing != names:
            what = f"column {missing[0]!r} is missing"
            raise InputError(path, "line 1", what, "give every joint's")
    remedy = f"add {torques[0]} .. or {currents[0]} .. of every joint"
    raise InputError(path, "line 1", "has no torques and no currents", remedy)


def _refuse_other_loads(path: Path, cell: Cell, numbers: dict[str, Array], lines: Array) -> None:
    """Raises InputError for a row whose load is not that of the cell, as the model has no other."""
    if _CARRIED not in numbers:
        return
    given, known = numbers[_CARRIED], cell.payload.mass
    k = int(np.abs(given - known).argmax())
    if abs(given[k] - known) > _SAME_LOAD * max(known, 1.0):
        what = f"is {given[k]:g}, where the cell carries {known:g} kg"
        remedy = "keep runs of one load, and state it as [payload]"
        raise InputError(path, f"line {lines[k]}, column {_CARRIED}", what, remedy)


def _numbers(
    path: Path,
    columns: tuple[str, ...],
    rows: Iterator[tuple[int, list[str]]],
    wanted: Sequence[str],
) -> tuple[list[str], Array, dict[str, Array]]:
    """Session and line of every row, and the wanted columns; rows are never held as text."""
    places = [columns.index(name) for name in wanted]
    session = columns.index("session") if "session" in columns else None
    sessions, lines, values = list[str](), array("q"), array("d")
    for line, row in rows:
        try:
            values.extend([float(row[i]) for i in places])
        except ValueError:
            for name in wanted:  # the table of one row says which cell it is
                CsvTable(path, columns, [row], [line], _REMEDY).numbers(name)
        sessions.append("run" if session is None else row[session].strip())
        lines.append(line)
    if not lines:
        raise InputError(path, "", "has a header and no rows", "add the samples")
    table = np.frombuffer(values).reshape(len(lines), len(wanted))
    for k, i in np.argwhere(~(np.abs(table) < _LARGEST_NUMBER))[:1].tolist():
        where = f"line {lines[k]}, column {wanted[i]}"
        raise InputError(path, where, "is no finite number of plausible size", _REMEDY)
    return sessions, np.array(lines), {name: table[:, i] for i, name in enumerate(wanted)}


def _joint_values(
    numbers: dict[str, Array], columns: Sequence[Column | None], without: float
) -> Array:
    """Values of joints (m, n), SI, of columns that some joints may be without."""
    none = np.full(len(numbers["time_s"]), without)
    return np.column_stack([none if c is None else numbers[c.name] * c.scale for c in columns])


# -- what a controller logs wrongly ------------------------------------------------------------


def _checked(path: Path, run: Run, lines: Array) -> tuple[list[Run], list[str]]:
    """Runs without breaks, and what to say of them. Raises InputError for stamps beyond repair."""
    said = list[str]()
    later = np.maximum.accumulate(run.time)
    good = np.concatenate([[True], run.time[1:] > later[:-1]])
    if (~good).any():
        first = f"line {int(lines[~good][0])}, column time_s"
        if (~good).mean() > _BAD_STAMPS:
            what = f"session {run.name} has {int((~good).sum())} stamps that do not increase"
            raise InputError(path, first, what, "sort the rows, or correct the clock")
        said.append(
            f"{path}: {first}: {int((~good).sum())} rows whose time does not increase left out"
        )
    run = _taken(run, good)
    if said_rate := _two_rates(run):
        said.append(f"{path}: session {run.name} {said_rate}")
    found = list[Run]()
    for piece in np.split(np.arange(len(run)), np.flatnonzero(np.diff(run.time) > _BREAK) + 1):
        part = _taken(run, piece)
        if len(part) < _FEWEST:
            continue
        if not (np.ptp(part.q, axis=0) > SLOW * part.step * 10.0).any():
            said.append(
                f"{path}: session {run.name} stands still from {part.time[0]:.3g} s; left out"
            )
            continue
        name = run.name if not found else f"{run.name} ({len(found) + 1})"
        found.append(replace(part, name=name))
    return found, said


def _two_rates(run: Run) -> str:
    """What to say of a run whose parts were logged at different rates."""
    parts = [np.median(p) for p in np.array_split(np.diff(run.time), 10) if len(p)]
    low, high = float(min(parts)), float(max(parts))
    return (
        f"is logged at two rates, every {low:.3g} s and every {high:.3g} s"
        if high > _OTHER_RATE * low
        else ""
    )


def _taken(run: Run, index: IntArray | Mask) -> Run:
    link = None if run.link is None else run.link[index]
    return Run(run.name, run.time[index], run.q[index], run.effort[index], link)


def _refuse_unsigned(path: Path, runs: Sequence[Run]) -> None:
    """Raises InputError where efforts carry no sign."""
    effort = np.concatenate([run.effort for run in runs])
    step = np.concatenate([np.diff(run.q, axis=0) for run in runs])
    both_ways = (step > 0).any(axis=0) & (step < 0).any(axis=0)
    positive = (effort >= 0.0).all(axis=0) & (effort > 0.0).any(axis=0)
    never: Mask = np.asarray(positive)[both_ways]
    if len(never) and never.mean() >= _UNSIGNED:
        what = "torques, or currents, are never negative though the joints move both ways"
        raise InputError(path, "", what, "log them with their sign")
