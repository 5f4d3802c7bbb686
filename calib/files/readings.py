"""The readings of a table: what one instrument reads of one marker in each row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray, Mask, TextArray
from calib.cell import Cell
from calib.errors import InputError
from calib.files.columns import SIGMAS, UNITS, Column, column_of, titles
from calib.files.csv_table import CsvTable
from calib.instruments import Instrument

_MOST_NAMED = 12


def reading_names(instruments: Iterable[Instrument | type[Instrument]]) -> set[str]:
    """Every column that may hold a number of these instruments, or of these kinds."""
    columns = (column for instrument in instruments for column in instrument.columns)
    return {title for own in columns for title in titles(own.name, UNITS[own.quantity])}


def written_columns(instrument: Instrument) -> list[Column]:
    """Columns in which readings are written, each in its first unit."""
    named = (titles(own.name, UNITS[own.quantity]) for own in instrument.columns)
    return [Column(*next(iter(own.items()))) for own in named]


def reading_columns(path: Path, instrument: Instrument, columns: tuple[str, ...]) -> list[Column]:
    """The column of each number. Raises InputError where one is missing or unitless."""
    present = []
    for name, quantity, optional in instrument.columns:
        named = titles(name, UNITS[quantity])
        column = column_of(path, columns, name, UNITS[quantity], f"reading {name!r}")
        if column is not None:
            present.append(column)
        elif not optional:
            alike = {own.casefold(): own for own in columns}
            other = next((alike[n.casefold()] for n in named if n.casefold() in alike), None)
            right = f"{other.lower()} and not {other!r}" if other else " or ".join(named)
            what = f"column {next(iter(named))} is missing"
            raise InputError(path, "line 1", what, f"name it {right}")
    return present


def readings_of(
    table: CsvTable, cell: Cell, pose: IntArray, count: int
) -> tuple[Array, Mask, Array]:
    """Readings (m, C, r), which of them are seen, and their own standard deviations (m, C), SI.

    pose : ndarray of int, shape (rows,), of each row, one of so many

    Raises InputError naming line and column for an unknown marker, one that stands twice, and numbers
    that cannot be.
    """
    names, known, channels = table.text("marker"), set(cell.read_names), cell.channels
    for row, name in enumerate(names):
        if name not in known:
            raise table.fault(row, "marker", *_unknown(cell, name))
    by_row, channel = _instruments(table, cell), np.zeros(len(names), dtype=int)
    readings = np.zeros((count, len(channels), channels.width))
    seen, sigma = np.zeros(readings.shape[:2], dtype=bool), np.full(readings.shape[:2], np.nan)
    for k, (instrument, part) in enumerate(channels.blocks):
        rows = np.flatnonzero(by_row == k)
        position = {name: c for c, name in enumerate(cell.channel_names[part], part.start)}
        for row in rows.tolist():
            if names[row] not in position:
                what = f"is nothing that instrument {instrument.name!r} reads"
                raise table.fault(row, "marker", what, "name another, or correct the instrument")
            channel[row] = position[names[row]]
        if len(rows):
            at = pose[rows], channel[rows]
            readings[(*at, slice(instrument.rows))] = _numbers(table, instrument, rows)
            sigma[at] = _own_sigma(table, instrument, rows, len(channels.instruments) == 1)
    for row, (i, c) in enumerate(zip(pose, channel, strict=True)):
        if seen[i, c]:
            what = f"pose {table.text('pose')[row]!r} has marker {names[row]!r} twice"
            remedy = "give a repeated reading its own pose identifier"
            raise table.fault(row, "marker", what, remedy)
        seen[i, c] = True
    return readings, seen, sigma


def _own_sigma(table: CsvTable, instrument: Instrument, rows: IntArray, alone: bool) -> Array:
    """Standard deviations (rows,) that a table gives of an instrument's rows, SI; else NaN.

    alone : whether the cell has no other instrument; with several a column may be empty
    """
    sigma, unit = np.full(len(rows), np.nan), instrument.numbers[0].unit
    for column in (own for own in SIGMAS if own in table.columns):
        of, scale = SIGMAS[column]
        text = table.text(column)
        given = np.array([bool(text[row]) or (alone and of == unit) for row in rows], bool)
        if of != unit and given.any():
            right = next(name for name, (u, _) in SIGMAS.items() if u == unit)
            what = f"is for readings in {of}, and {instrument.name!r} reads {unit}"
            raise table.fault(int(rows[given][0]), column, what, f"give it in column {right}")
        sigma[given] = table.numbers(column, rows[given]) * scale
        for row in rows[given][sigma[given] <= 0][:1].tolist():
            remedy = "leave the column out for the cell's"
            raise table.fault(row, column, "must be above zero", remedy)
    return sigma


def sites_of(table: CsvTable, cell: Cell, pose: IntArray, first: IntArray) -> TextArray | None:
    """Which place of an instrument with sites each pose touches, shape (m,); None without any.

    pose : ndarray of int, shape (rows,), of each row; first : ndarray of int, shape (m,), rows

    Raises InputError where one pose touches two.
    """
    sites = [name for own in cell.instruments for name in own.sites]
    if not sites or "instrument" not in table.columns:
        return None
    named = np.array([name if name in sites else "" for name in table.text("instrument")])
    touched = named[first]
    for row in np.flatnonzero(named != ""):
        if touched[pose[row]] not in ("", named[row]):
            what = f"pose {table.text('pose')[row]!r} touches {str(touched[pose[row]])!r} too"
            raise table.fault(int(row), "instrument", what, "give each its own pose identifier")
        touched[pose[row]] = named[row]
    return touched


def _numbers(table: CsvTable, instrument: Instrument, rows: IntArray) -> Array:
    """Numbers of an instrument's rows, shape (rows, k), SI: those that its columns hold.

    An optional column, which may have empty fields, is the only one of its instrument.
    """
    columns = reading_columns(table.path, instrument, table.columns)
    numbers = np.zeros((len(rows), len(columns)))
    for k, (name, scale) in enumerate(columns):
        given = np.ones(len(rows), dtype=bool)
        if any(column.optional for column in instrument.columns):
            text = table.text(name)
            given = np.array([bool(text[row]) for row in rows])
        numbers[given, k] = table.numbers(name, rows[given]) * scale
    read = instrument.row_of(numbers)
    for row in rows[~np.isfinite(read).all(axis=1)][:1].tolist():
        kinds = [column.quantity for column in instrument.columns]
        name = columns[kinds.index("ratio")][0]
        what = f"and what belongs to it are no reading of kind {instrument.kind}"
        raise table.fault(row, name, what, "a quaternion has a length of one")
    return read


def _instruments(table: CsvTable, cell: Cell) -> IntArray:
    """Which instrument read each row, shape (rows,)."""
    numbers = {name: k for k, own in enumerate(cell.instruments) for name in own.names}
    if len(numbers) == 1:
        return np.zeros(len(table.rows), dtype=int)
    known = f"instruments are {', '.join(numbers)}"
    if "instrument" not in table.columns:
        what = "column 'instrument' is missing and the cell has several"
        raise InputError(table.path, "line 1", what, f"add it; {known}")
    names = table.text("instrument")
    for row, name in enumerate(names):
        if name not in numbers:
            raise table.fault(row, "instrument", f"{name!r} is not in the cell", known)
    return np.array([numbers[name] for name in names])


def _unknown(cell: Cell, name: str) -> tuple[str, str]:
    """What is wrong with a name that nothing reads, and what there is in its place."""
    board = name.partition(":")[0]
    points = [own for own in cell.read_names if own.startswith(f"{board}:")]
    if board != name and points:
        return f"{name!r} is no point of [boards.{board}]", _listed("its points are", points)
    boards = dict.fromkeys(n.partition(":")[0] for n in cell.read_names if ":" in n)
    tables = [f"[boards.{own}]" for own in boards]
    if not boards or any(":" not in own for own in cell.read_names):
        tables = ["[markers_mm]", *["[bodies]"] * bool(cell.bodies), *tables]
    known = _listed("markers are", cell.read_names)
    return f"{name!r} is not in the cell's {' or '.join(tables)}", known


def _listed(what: str, names: Sequence[str]) -> str:
    return f"{what} {', '.join(names[:_MOST_NAMED])}{' ..' if len(names) > _MOST_NAMED else ''}"
