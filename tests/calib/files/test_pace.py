"""Speeds of joints: from the URDF, and from the cell in their place; and the pace of a day."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib import load_cell
from studies.demo.embedded import embedded_text


def test_speeds_of_the_urdf_and_of_the_cell(tmp_path: Path) -> None:
    urdf = embedded_text("kr270.urdf").replace('velocity="0"', 'velocity="1.5"', 2)
    (tmp_path / "kr270.urdf").write_text(urdf)
    more = (
        "\n[robot.speed_deg_s]\nA2 = 90\nA6 = 180\n[robot.acceleration_deg_s2]\nA1 = 360\n"
        "[timing]\nspeed_percent = 25\nread_s = 4\n"
    )
    (tmp_path / "cell.toml").write_text(embedded_text("cell.toml") + more)
    cell = load_cell(tmp_path / "cell.toml")
    speeds = [1.5, np.pi / 2, np.nan, np.nan, np.nan, np.pi]
    np.testing.assert_allclose(cell.robot.speeds, speeds)
    np.testing.assert_allclose(cell.robot.accelerations, [2 * np.pi, *5 * [np.nan]])
    assert (cell.pace.speed, cell.pace.reading, cell.pace.settle) == (0.25, 4.0, 2.0)


def test_no_speed_is_known_by_default(tmp_path: Path) -> None:
    for name in ("kr270.urdf", "cell.toml"):
        (tmp_path / name).write_text(embedded_text(name))
    assert np.isnan(load_cell(tmp_path / "cell.toml").robot.speeds).all()
