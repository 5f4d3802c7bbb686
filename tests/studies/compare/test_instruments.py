"""``compare --with``: instruments side by side at one plan."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from tests.studies.command_line import paper_cell, result, run


def written(folder: Path, name: str, sigma: float, robot: str = "") -> Path:
    lines = paper_cell(folder, "base", "tool", "joint_offset:A2,A3").read_text().splitlines()
    lines = [f"sigma_mm = {sigma}" if line.startswith("sigma_mm") else line for line in lines]
    at = lines.index("[robot]")
    path = folder / name
    path.write_text("\n".join([*lines[: at + 1], robot, *lines[at + 1 :]]) + "\n")
    return path


def compared(folder: Path, *paths: Path) -> tuple[str, list[dict[str, float]]]:
    first, *others = map(str, paths)
    call = ["compare", first, str(folder / "plan.csv"), "--monte-carlo", "0"]
    for other in others:
        call += ["--with", other]
    fields, said = result(folder / "r.json", *call)
    return said, fields["read_by"]


def test_an_instrument_of_twice_the_noise_needs_four_times_the_poses(tmp_path: Path) -> None:
    good, poor = written(tmp_path, "good.toml", 0.01), written(tmp_path, "poor.toml", 0.02)
    said, (first, second) = compared(tmp_path, good, poor)
    assert second["task_rms_mm"] == pytest.approx(2.0 * first["task_rms_mm"], rel=1e-6)
    assert first["poses_to_match"] == pytest.approx(15.0)
    assert second["poses_to_match"] == pytest.approx(60.0, rel=1e-6)
    assert first["arm_rms_mm"] is None
    assert "poses to" in said


def test_where_the_arm_sets_the_limit_it_is_said(tmp_path: Path) -> None:
    scatter = "repeatability_mm = 0.2"
    good = written(tmp_path, "good.toml", 0.01, scatter)
    poor = written(tmp_path, "poor.toml", 0.02, scatter)
    said, (first, second) = compared(tmp_path, good, poor)
    assert first["arm_rms_mm"] == pytest.approx(second["arm_rms_mm"], rel=1e-3)
    assert 0.9 < first["arm_rms_mm"] / first["task_rms_mm"] < 1.0
    assert "A better instrument gains little" in said


def test_another_robot_is_refused(tmp_path: Path) -> None:
    cell = written(tmp_path, "cell.toml", 0.01)
    other = tmp_path / "other.toml"
    other.write_text(cell.read_text().replace('tip = "tool0"', 'tip = "link_5"'))
    done = run("compare", cell, tmp_path / "plan.csv", "--with", other, "--monte-carlo", 0)
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert "other.toml" in done.stderr


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
    written(tmp_path, "tracker.toml", 0.01)
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
    assert plan["by_markers"]["counts"] == []  # a board is read as a whole
    assert {path.stem for path in figures.glob("*.svg")} >= {"deviations", "predicted_simulated"}


@pytest.mark.parametrize("trials", ["0", "20"])
def test_a_camera_that_sees_nothing_is_refused_in_a_line(photographed: Path, trials: str) -> None:
    for more in ((), ("--with", str(photographed / "away.toml"))):
        first = "ahead.toml" if more else "away.toml"
        done = asked(photographed, first, "--monte-carlo", trials, *more)
        assert done.exit_code == 2, done.output
        (line,) = done.stderr.splitlines()
        assert "away.toml" in line
        assert "cam sees no point at any pose of near.csv" in line
        assert "posecal design" in line


def test_nothing_matches_what_is_not_known(photographed: Path) -> None:
    """The tracker's poses leave parameters open, so nothing can be said to match it."""
    tracker = photographed / "tracker.toml"
    wide = '"geometry", "stiffness_vs_angle:A2"'
    tracker.write_text(tracker.read_text().replace('"joint_offset:A2,A3"', wide))
    out = photographed / "r.json"
    more = ("--with", str(photographed / "ahead.toml"), "--monte-carlo", "0", "--json", str(out))
    done = asked(photographed, "tracker.toml", *more)
    assert done.exit_code == 0, done.output
    first, second = json.loads(out.read_text())["read_by"]
    assert first["task_rms_mm"] is None
    assert second["task_rms_mm"] > 0.0
    assert second["poses_to_match"] is None
