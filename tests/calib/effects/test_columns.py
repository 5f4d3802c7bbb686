"""What effects take from a table and from the cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.errors import InputError
from tests.helpers import measured_cell


def test_columns_of_torques(tmp_path: Path) -> None:
    folder = measured_cell(tmp_path)
    cell = calib.load_cell(folder / "cell.toml")
    header, *rows = (folder / "measurements.csv").read_text().splitlines()
    names = [f"{joint}_Nm" for joint in cell.robot.joints]
    values = {row.partition(",")[0]: float(len(row) % 7) for row in rows}

    def loaded(names: list[str]) -> calib.Measurements:
        own = [[values[row.partition(",")[0]] + j for j in range(len(names))] for row in rows]
        lines = [f"{row},{','.join(map(str, t))}" for row, t in zip(rows, own, strict=True)]
        path = tmp_path / "torques.csv"
        path.write_text("\n".join([f"{header},{','.join(names)}", *lines]) + "\n")
        return calib.load_measurements(cell, path)

    poses = loaded(names).poses
    expected = [[values[name] + j for j in range(len(names))] for name in poses.names]
    np.testing.assert_allclose(np.asarray(poses.torque), expected)
    assert calib.load_measurements(cell, folder / "measurements.csv").poses.torque is None
    with pytest.raises(InputError, match=f"'{names[-1]}' is missing beside"):
        loaded(names[:-1])


def test_gear_ratios_of_the_cell(tmp_path: Path) -> None:
    path = measured_cell(tmp_path) / "cell.toml"
    path.write_text(f"{path.read_text()}\n[robot.gear_ratio]\nA2 = 121\n")
    assert calib.load_cell(path).gear_ratios == {"A2": 121.0}
