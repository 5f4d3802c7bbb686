"""Cells and tables of measurements below a folder, and which belongs to which."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

_CELL = "cell"
_ROBOT = re.compile(r"^\s*\[robot\]", re.MULTILINE)
_MOST = 2_000_000  # characters; a larger TOML is no cell
_DATE = re.compile(r"(?<!\d)(20\d\d)([-_.]?)(\d\d)\2(\d\d)(?!\d)")


@dataclass(frozen=True)
class Job:
    """A table of a robot.

    robot : name of the robot, the place of its cell below the folder
    table : None where the cell has none; label : its place below the folder
    day : YYYY-MM-DD, of its name or of the folders between it and the cell; None where there is none
    """

    robot: str
    cell: Path
    table: Path | None
    label: str
    day: str | None

    def result(self, verb: str) -> Path:
        """Where a result of it stands: beside the table, named after it."""
        table = self.table or self.cell
        known = self.cell.stem == _CELL or table.stem.startswith(self.cell.stem)
        stem = table.stem if known else f"{table.stem}.{self.cell.stem}"
        return table.with_name(f"{stem}.{verb}.json")


def find(folder: Path, without: str | None = None) -> list[Job]:
    """Every cell below a folder with its tables, in the order of names.

    without : file name of tables that hold poses out and are no measurements of their own

    A table belongs to the next cell at or above it. Where several stand in one folder, it belongs to
    the one whose name its own begins with, else to each.
    """
    jobs = []
    cells: dict[Path, list[Path]] = {}
    tables: dict[Path, list[Path]] = {}
    for place, files in _walk(folder):
        own = [place / name for name in files if name.endswith(".toml")]
        cells[place] = [path for path in own if _is_cell(path)] or cells.get(place.parent, [])
        for name in files:
            if name.endswith(".csv") and name != without:
                _assign(place / name, cells[place], tables)
        jobs += [path for path in own if path in cells[place]]
    return [job for cell in sorted(jobs) for job in _jobs(folder, cell, tables.get(cell, []))]


def _walk(folder: Path) -> Iterator[tuple[Path, list[str]]]:
    """Folders from the top down, hidden ones left out."""
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield Path(place), sorted(name for name in files if not name.startswith("."))


def _is_cell(path: Path) -> bool:
    """Whether a TOML describes a cell, well or badly."""
    if path.stem == _CELL:
        return True
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            return _ROBOT.search(file.read(_MOST)) is not None
    except OSError:
        return False


def _assign(table: Path, cells: list[Path], tables: dict[Path, list[Path]]) -> None:
    from calib.files.tables import holds_points

    if not cells or not holds_points(table):
        return
    named = [cell for cell in cells if table.name.startswith(cell.stem)]
    longest = [max(named, key=lambda cell: len(cell.stem))] if named else cells
    for cell in longest:
        tables.setdefault(cell, []).append(table)


def _jobs(folder: Path, cell: Path, tables: list[Path]) -> Iterator[Job]:
    place = cell.relative_to(folder)
    robot = place.parent if cell.stem == _CELL else place.with_suffix("")
    name = robot.as_posix() if robot.parts else folder.resolve().name
    if not tables:
        yield Job(name, cell, None, "", None)
    for table in sorted(tables):
        label = table.relative_to(folder).as_posix()
        yield Job(name, cell, table, label, _day(table.relative_to(cell.parent).as_posix()))


def _day(name: str) -> str | None:
    """The last date that a name holds.

    >>> _day("2026-03-01/measurements.csv"), _day("r7_20260301.csv"), _day("r7_20261350.csv")
    ('2026-03-01', '2026-03-01', None)
    """
    for year, _, month, day in reversed(_DATE.findall(name)):
        try:
            return date(int(year), int(month), int(day)).isoformat()
        except ValueError:
            continue
    return None
