"""A written table as it will be read: before it is written."""

from __future__ import annotations

import tempfile
from pathlib import Path

import calib
from calib import Cell
from calib.errors import InputError


def read_back(cell: Cell | None, table: str, target: Path, every_marker: bool) -> tuple[str, ...]:
    """Warnings of the table as ``load_measurements`` reads it; none where there is no cell.

    every_marker : whether each that the cell reads must be there

    Raises InputError naming the target.
    """
    if cell is None:
        return ()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        path.write_text(table, encoding="utf-8", newline="")
        try:
            read = calib.load_measurements(cell, path, every_marker=every_marker)
        except InputError as error:
            where = f"as joined, {error.where}" if error.where else "as joined"
            raise InputError(target, where, error.what, error.remedy) from None
        return tuple(text.replace(str(path), str(target)) for text in read.warnings)
