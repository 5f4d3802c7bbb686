"""The real measurements that benchmarks are run on: folders of POSECAL_DATA, or beside the project."""

from __future__ import annotations

import os
from pathlib import Path

import calib
from calib.cell import Cell
from calib.poses import Measurements

_BESIDE = Path(__file__).parents[4] / "shared" / "data"


def folder_of(name: str) -> Path:
    """Where a set is, or would be."""
    return Path(os.environ.get("POSECAL_DATA", _BESIDE)) / name


def read(name: str) -> tuple[Cell, Measurements]:
    """Cell and measurements of a set. Raises InputError where it is not there."""
    cell = calib.load_cell(folder_of(name) / "cell.toml")
    return cell, calib.load_measurements(cell, folder_of(name) / "measurements.csv")
