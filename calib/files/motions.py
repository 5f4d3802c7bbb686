"""Read ``motion.csv``: joint angles and torques, or currents, of runs over time."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.errors import InputError
from calib.files.columns import column_of, joint_columns, titles, units_of
from calib.files.csv_table import bounded_lines, header
from calib.files.read import check_file
from calib.motion.filtering import SLOW
from calib.motion.motions import Motions, Run, Unit

_LARGEST_FILE = 2_000_000_000  # bytes
_LARGEST_NUMBER = 1e12
_FEWEST = 50  # rows of a run
_BAD_STAMPS = 0.01  # share of a run's rows that may go
_BREAK = 0.5  # s, beyond which a run begins anew
_OTHER_RATE = 1.6  # times: between parts of a run
_TWICE = 0.4  # share of rows that repeat the one before while the robot moves
_UNSIGNED = 2.0 / 3.0  # share of the joints


def holds_motions(path: Path) -> bool:
    """Whether a table holds motions: a header of times without markers and poses."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            names = {name.strip() for name in next(csv.reader(file), [])}
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    driven = any(name.endswith(("_Nm", "_N", "_A")) for name in names)
    return driven and "time_s" in names and not names & {"marker", "pose", "instrument"}


def load_motions(cell: Cell, path: str | Path) -> Motions:
    """The runs of a table, in SI; currents as torques where the cell states the constants.

    Raises InputError, naming line and column, for what is no table of this robot's motions.
    """
    path, robot = Path(path), cell.robot
    check_file(path, _LARGEST_FILE)
    reader = csv.reader(bounded_lines(path), strict=True)
    columns = header(path, reader, ("time_s",))
    given = joint_columns(path, robot, columns)
    efforts, unit = _efforts(path, columns, robot.joints, robot.prismatic)
    also = {
        kind: [
            column_of(path, columns, f"{j}_{kind}", units_of(s), f"{j}_{kind}")
            for j, s in zip(robot.joints, robot.prismatic.tolist(), strict=True)
        ]
        for kind in ("cmd", "link")
    }
    wanted = ["time_s", *(c.name for c in given if c is not None), *efforts]
    wanted += [name for names in also.values() for name in names if name]
    sessions, lines, numbers = _numbers(path, reader, columns, list(dict.fromkeys(wanted)))
    q = np.column_stack(
        [np.zeros(len(lines)) if c is None else c.joint(numbers[c.name]) for c in given]
    )
    effort = np.column_stack([numbers[name] for name in efforts])
    if unit == "A" and all(joint in cell.motion.constants for joint in robot.joints):
        effort = effort * [cell.motion.constants[joint] for joint in robot.joints]
        unit = "Nm"
    others = {kind: _optional(numbers, names, robot.joints, kind, robot.prismatic)
              for kind, names in also.items()}  # fmt: skip
    runs, warnings = list[Run](), list[str]()
    for name in dict.fromkeys(sessions):
        own = np.flatnonzero(np.array(sessions) == name)
        run = Run(name, numbers["time_s"][own], robot.tied(q[own]), effort[own],
                  *(None if o is None else o[own] for o in others.values()))  # fmt: skip
        found, said = _checked(path, run, lines[own])
        runs += found
        warnings += said
    if not runs:
        raise InputError(path, "", "holds no run in which a joint moves", "log the robot in motion")
    _refuse_unsigned(path, runs)
    return Motions(tuple(runs), unit, tuple(warnings))


def _efforts(
    path: Path, columns: Sequence[str], joints: Sequence[str], prismatic: Mask
) -> tuple[list[str], Unit]:
    """Columns of torque or current of every joint. Raises InputError where one has none."""
    torques = [f"{j}_{'N' if s else 'Nm'}" for j, s in zip(joints, prismatic, strict=True)]
    currents = [f"{j}_A" for j in joints]
    for names, unit in ((torques, "Nm"), (currents, "A")):
        present = [name in columns for name in names]
        if all(present):
            return names, "Nm" if unit == "Nm" else "A"
        if any(present):
            missing = names[present.index(False)]
            raise InputError(path, "line 1", f"column {missing!r} is missing", "give every joint's")
    remedy = f"add {torques[0]} .. or {currents[0]} .. of every joint"
    raise InputError(path, "line 1", "has no torques and no currents", remedy)


def _numbers(
    path: Path, reader: Iterator[list[str]], columns: Sequence[str], wanted: Sequence[str]
) -> tuple[list[str], Array, dict[str, Array]]:
    """Session and line of every row, and the wanted columns; rows are never held as text."""
    places = [columns.index(name) for name in wanted]
    session = columns.index("session") if "session" in columns else None
    sessions, lines, values = list[str](), array("q"), array("d")
    try:
        for row in filter(any, reader):
            if len(row) != len(columns):
                what = f"has {len(row)} fields, the header {len(columns)}"
                raise InputError(path, f"line {reader.line_num}", what, "complete the row")  # type: ignore[attr-defined]
            try:
                values.extend([float(row[i]) for i in places])
            except ValueError:
                i = next(i for i in places if not _is_number(row[i]))
                where = f"line {reader.line_num}, column {columns[i]}"  # type: ignore[attr-defined]
                raise InputError(path, where, f"{row[i][:40]!r} is not a number",
                                 "leave the row out if it was not logged") from None  # fmt: skip
            sessions.append("run" if session is None else row[session].strip())
            lines.append(reader.line_num)  # type: ignore[attr-defined]
    except UnicodeDecodeError:
        raise InputError(path, "", "is not text in UTF-8", "export it as CSV") from None
    except csv.Error as error:
        raise InputError(path, "", f"is no CSV ({error})", "check the quotation marks") from None
    if not lines:
        raise InputError(path, "", "has a header and no rows", "add the samples")
    table = np.frombuffer(values).reshape(len(lines), len(wanted))
    for row, k in np.argwhere(~(np.abs(table) < _LARGEST_NUMBER))[:1].tolist():
        where = f"line {lines[row]}, column {wanted[k]}"
        raise InputError(path, where, "is no finite number of plausible size", "leave the row out")
    return sessions, np.array(lines), {name: table[:, k] for k, name in enumerate(wanted)}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _optional(
    numbers: dict[str, Array],
    names: Sequence[str | None],
    joints: Sequence[str],
    kind: str,
    prismatic: Mask,
) -> Array | None:
    """Columns of a second angle (m, n), SI, NaN where a joint has none; None where none has."""
    if not any(names):
        return None
    count = len(next(iter(numbers.values())))
    found = np.full((count, len(joints)), np.nan)
    for j, name in enumerate(names):
        if name:
            scale = titles(f"{joints[j]}_{kind}", units_of(bool(prismatic[j])))[name]
            found[:, j] = numbers[name] * scale
    return found


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
    repeated = np.concatenate([[False], (np.diff(run.q, axis=0) == 0.0).all(axis=1)])
    moving = np.concatenate([[False], (np.abs(np.diff(run.q, axis=0)) > 0.0).any(axis=1)])
    if moving.any() and repeated[moving.argmax() :].mean() > _TWICE and _steady(repeated, moving):
        said.append(
            f"{path}: session {run.name}: every row stands twice, logged faster than measured; "
            "each counts once"
        )
        good &= ~repeated
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


def _steady(repeated: Mask, moving: Mask) -> bool:
    """Whether every second row repeats the one before wherever the robot moves."""
    pairs = repeated[1:] ^ repeated[:-1]
    near = moving[1:] | moving[:-1]
    return bool(pairs[near].mean() > 0.8)


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
    parts = (None if own is None else own[index] for own in (run.command, run.link))
    return Run(run.name, run.time[index], run.q[index], run.effort[index], *parts)


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
