"""Days of the independent truth as posecal reads them, for all that counts what it says of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike

import calib
from calib.arrays import Array
from calib.cell.targets import targets_of
from studies.research.truth.day import Columns, Day, write_day


@dataclass(frozen=True, eq=False)
class Read:
    """A day, its cell and data, and what a perfect day had read."""

    day: Day
    cell: calib.Cell
    data: calib.Measurements
    exact: calib.Measurements

    @property
    def targets(self) -> calib.Poses:
        """Those of the cell."""
        return targets_of(self.cell)[0]


def read(day: Day, rows: Columns = (), asked: Columns = ()) -> Read:
    """A day as its files say it; see :func:`write_day`."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_day(folder, day, read=rows, asked=asked)
        cell = calib.load_cell(folder / "cell.toml")
        tables = (folder / f"{table}.csv" for table in ("measurements", "exact"))
        return Read(day, cell, *(calib.load_measurements(cell, table) for table in tables))


def moved(q: Array, joint: int, off: ArrayLike) -> Array:
    """Joints (N, n) of which one is off by so much, shape (N,)."""
    return np.asarray(q + np.asarray(off)[..., None] * (np.arange(q.shape[1]) == joint))
