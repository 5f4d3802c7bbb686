"""A table that is whole already, but written as a spreadsheet of another country writes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.joints import titled
from calib.files.exports.sheet import read_sheet


@dataclass(frozen=True)
class WholeTable:
    """Columns as ``measurements.csv`` names them, and rows of text with decimal points."""

    path: Path
    columns: tuple[str, ...]
    rows: list[list[str]]


def read_whole(path: Path) -> WholeTable:
    """Read a table of measurements or a plan, whatever separates its columns.

    Raises InputError where it is a list of points or joints alone.
    """
    sheet = read_sheet(path)
    columns = tuple(titled(text) for text in sheet.header or ())
    if "pose" not in columns:
        what = "has no column 'pose', as a table of measurements or a plan has"
        raise InputError(path, "header", what, "name it so, or give the joints by --joints FILE")
    return WholeTable(path, columns, [[sheet.pointed(text) for text in row] for row in sheet.rows])
