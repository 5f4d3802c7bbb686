"""``compare --with``: instruments side by side at one plan."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from studies.cli import main
from studies.demo.embedded import embedded_text

EFFECTS = 'effects = ["base", "tool", "joint_offset:A2,A3"]'


def written(folder: Path, name: str, sigma: float, robot: str = "") -> Path:
    lines = embedded_text("cell.toml").splitlines()
    lines = [EFFECTS if line.startswith("effects =") else line for line in lines]
    lines = [f"sigma_mm = {sigma}" if line.startswith("sigma_mm") else line for line in lines]
    at = lines.index("[robot]")
    (folder / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    (folder / "plan.csv").write_text(embedded_text("plan.csv"))
    path = folder / name
    path.write_text("\n".join([*lines[: at + 1], robot, *lines[at + 1 :]]) + "\n")
    return path


def compared(folder: Path, *paths: Path) -> tuple[Result, list[dict[str, float]]]:
    first, *others = map(str, paths)
    call = ["compare", first, str(folder / "plan.csv"), "--monte-carlo", "0"]
    for other in others:
        call += ["--with", other]
    done = CliRunner().invoke(main, [*call, "--json", str(folder / "r.json")])
    assert done.exit_code == 0, done.output
    return done, json.loads((folder / "r.json").read_text())["read_by"]


def test_an_instrument_of_twice_the_noise_needs_four_times_the_poses(tmp_path: Path) -> None:
    good, poor = written(tmp_path, "good.toml", 0.01), written(tmp_path, "poor.toml", 0.02)
    done, (first, second) = compared(tmp_path, good, poor)
    assert second["task_rms_mm"] == pytest.approx(2.0 * first["task_rms_mm"], rel=1e-6)
    assert first["poses_to_match"] == pytest.approx(15.0)
    assert second["poses_to_match"] == pytest.approx(60.0, rel=1e-6)
    assert first["arm_rms_mm"] is None
    assert "poses to" in done.output


def test_where_the_arm_sets_the_limit_it_is_said(tmp_path: Path) -> None:
    scatter = "repeatability_mm = 0.2"
    good = written(tmp_path, "good.toml", 0.01, scatter)
    poor = written(tmp_path, "poor.toml", 0.02, scatter)
    done, (first, second) = compared(tmp_path, good, poor)
    assert first["arm_rms_mm"] == pytest.approx(second["arm_rms_mm"], rel=1e-3)
    assert 0.9 < first["arm_rms_mm"] / first["task_rms_mm"] < 1.0
    assert "a better instrument gains little" in " ".join(done.output.split())


def test_another_robot_is_refused(tmp_path: Path) -> None:
    cell = written(tmp_path, "cell.toml", 0.01)
    other = tmp_path / "other.toml"
    other.write_text(cell.read_text().replace('tip = "tool0"', 'tip = "link_5"'))
    call = ["compare", str(cell), str(tmp_path / "plan.csv"), "--with", str(other)]
    done = CliRunner().invoke(main, [*call, "--monte-carlo", "0"])
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert "other.toml" in done.stderr
