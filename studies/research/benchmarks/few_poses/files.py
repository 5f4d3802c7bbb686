"""The user's side of a day: a cell and a table, as posecal has them."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import calib
from calib.arrays import Array
from calib.poses import Measurements, poses_at
from studies.research.benchmarks.few_poses.truth import SIGMA, Day
from studies.research.withheld.texts import urdf

DEFAULT, OFF = "posecal", "posecal, off"


def cells_of(day: Day) -> dict[str, calib.Cell]:
    """Ways of posecal: by default, and with ``size_prior = "off"`` where it knows that key."""
    ways = {DEFAULT: read_cell(day)}
    try:
        ways[OFF] = read_cell(day, 'size_prior = "off"')
    except calib.CalibError as refused:
        if "size_prior" not in str(refused):
            raise
    return ways


def read_cell(day: Day, more: str = "") -> calib.Cell:
    """The cell of a day; more : a line of its [model]."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "robot.urdf").write_text(urdf(day.arm, masses=False), encoding="utf-8")
        (folder / "cell.toml").write_text(_cell(day, more), encoding="utf-8")
        return calib.load_cell(folder / "cell.toml")


def table_of(q: Array, points: Array) -> Measurements:
    """Points (m, M, 3), m, read at joints (m, n), as a table holds them."""
    shape = points.shape[:-1]
    return Measurements(poses_at(q), points, np.ones(shape, dtype=bool), np.full(shape, np.nan))


def _cell(day: Day, more: str) -> str:
    markers = [f"m{i} = {(m * 1e3).round(4).tolist()}" for i, m in enumerate(day.guesses, 1)]
    lines = ["schema = 1", 'name = "few poses"', "[robot]", 'urdf = "robot.urdf"']
    lines += [f'base = "{day.arm.base}"', f'tip = "{day.arm.tip}"', "[markers_mm]", *markers]
    lines += ["[instrument]", f"sigma_mm = {SIGMA * 1e3:g}"]
    return "\n".join([*lines, "[model]", 'effects = ["base", "tool", "geometry"]', more, ""])
