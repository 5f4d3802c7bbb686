"""Plans that cameras read, compared."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from tests.studies.command_line import paper_cell, run

CAMERA = """schema = 1
name = "cam"
[robot]
urdf = "kr270.urdf"
base = "base_link"
tip = "tool0"
[boards.b]
on = "tip"
squares = [8, 11]
pitch_mm = 20
[instruments.cam]
kind = "camera"
on = "world"
position_mm = [4500, 0, 1000]
rpy_deg = {look}
focal_px = 1000
center_px = [639.5, 479.5]
image_px = [1280, 960]
sigma_px = 0.1
[model]
effects = ["base", "tool", "geometry"]
"""
AHEAD, AWAY = "[-90, 0, 90]", "[-90, 0, -90]"


@pytest.fixture
def photographed(tmp_path: Path) -> Path:
    """A folder with a camera that stands before the arm, and poses that show it the board."""
    paper_cell(tmp_path)
    (tmp_path / "ahead.toml").write_text(CAMERA.format(look=AHEAD))
    (tmp_path / "away.toml").write_text(CAMERA.format(look=AWAY))
    turns = np.array([0, -60, 90, 0, 30, 0]) + np.random.default_rng(0).uniform(
        -1.0, 1.0, (15, 6)
    ) * (20, 20, 20, 34, 34, 34)
    rows = [",".join([f"p{i}", *(f"{x:.4f}" for x in row)]) for i, row in enumerate(turns)]
    head = "pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg"
    (tmp_path / "near.csv").write_text("\n".join([head, *rows, ""]))
    return tmp_path


def asked(folder: Path, cell: str, *more: str) -> Result:
    return run("compare", folder / cell, folder / "near.csv", *more)


@pytest.mark.long
def test_a_camera_alone_is_predicted_simulated_and_drawn(photographed: Path) -> None:
    figures, out = photographed / "figures", photographed / "r.json"
    more = ("--monte-carlo", "40", "--workers", "1", "--figures", str(figures), "--json", str(out))
    done = asked(photographed, "ahead.toml", *more)
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    (plan,) = found["plans"]
    assert [own["approach"] for own in plan["approaches"]] == ["points"]
    assert found["agreement"]["believed"] is True
    assert {path.stem for path in figures.glob("*.svg")} >= {"deviations_by_approach", "ellipses"}


@pytest.mark.parametrize("trials", ["0", "20"])
def test_a_camera_that_sees_nothing_is_refused_in_a_line(photographed: Path, trials: str) -> None:
    done = asked(photographed, "away.toml", "--monte-carlo", trials)
    assert done.exit_code == 2, done.output
    (line,) = done.stderr.splitlines()
    assert "away.toml" in line
    assert "cam sees no point at any pose of near.csv" in line
    assert "posecal design" in line
