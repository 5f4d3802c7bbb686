"""``posecal changes`` as a user sees it a month after the last calibration."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.poses import poses_at
from calib.simulation import drawn_readings
from tests.studies.command_line import paper_cell, result, run

SLIP = 3e-4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """May and June of one robot, of which the belt of A3 slipped in between, and of July nothing."""
    path = tmp_path_factory.mktemp("months")
    cell = calib.load_cell(paper_cell(path, "base", "tool", "geometry"))
    low, high = cell.robot.sample_limits().T
    for seed, month in enumerate(("may", "june", "july")):
        rng = np.random.default_rng(seed)
        poses = poses_at(rng.uniform(low, high, (25, 6)))
        model = build(cell, poses).model
        truth = np.zeros(len(model.parameters))
        truth[:6] = [2.0, -1.0, 0.3, 0.1, -0.2, 0.5]
        slipped = [p.id for p in model.parameters].index("geometry:A3.ry")
        truth[slipped] = 1e-3 + SLIP * (month == "june")
        data = drawn_readings(model, truth, poses, cell.noise, rng)
        (path / f"{month}.csv").write_text(measurements_csv(cell, data))
        done = run("identify", path / "cell.toml", path / f"{month}.csv", "--json",
                   path / f"{month}.json")  # fmt: skip
        assert done.exit_code == 0, done.output
    return path


def changes(folder: Path, before: str, after: str, *more: object) -> tuple[dict[str, Any], str]:
    call = ("changes", folder / before, folder / after, *more)
    return result(folder / "out.json", *call, kind="changes")


def test_a_slipped_belt_is_told_with_what_it_does(folder: Path) -> None:
    fields, said = changes(folder, "may.json", "june.json", "--tolerance-mm", 0.1)
    assert fields["status"] == "changed"
    (moved,) = [p for p in fields["parameters"] if p["moved"]]
    assert moved["id"] == "geometry:A3.ry"
    assert moved["change"] == pytest.approx(SLIP * 1e6, rel=0.05)
    assert fields["verdict"] == "does_not"
    assert fields["kept_worst_mm"]["low"] > 0.1
    assert "may.json does not hold within 0.1 mm: worst target" in said
    assert "Moved: geometry:A3.ry" in said
    assert [Path(i["file"]).name for i in fields["inputs"]] == [
        "cell.toml", "kr270.urdf", "may.json", "june.json",
    ]  # fmt: skip


def test_a_robot_that_stayed_still_holds(folder: Path) -> None:
    fields, said = changes(folder, "may.json", "july.json", "--tolerance-mm", 0.1)
    assert (fields["status"], fields["verdict"]) == ("unchanged", "holds")
    assert "Nothing moved between may.json and july.json" in said
    assert "would go unnoticed" in said
    worst = fields["kept_worst_mm"]
    between = (worst["low"] + worst["high"]) / 2.0
    assert worst["low"] < between < worst["high"] < 0.1
    tight, _ = changes(folder, "may.json", "july.json", "--tolerance-mm", between)
    assert tight["verdict"] == "cannot_be_said"
    free, _ = changes(folder, "may.json", "july.json")
    assert free["verdict"] is None


def test_a_cell_that_changed(folder: Path, tmp_path: Path) -> None:
    for name in ("may.json", "june.json", "kr270.urdf", "cell.toml"):
        shutil.copy(folder / name, tmp_path / name)
    moved = {}
    for month in ("may", "june"):
        fields = json.loads((folder / f"{month}.json").read_text())
        for entry in fields["inputs"]:
            entry["file"] = Path(entry["file"]).name
        (tmp_path / f"{month}.json").write_text(json.dumps(fields))
        moved[month] = tmp_path / f"{month}.json"
    done = run("changes", moved["may"], moved["june"])
    assert done.exit_code == 0, done.output
    assert "geometry:A3.ry" in done.output
    text = (tmp_path / "cell.toml").read_text()
    (tmp_path / "cell.toml").write_text(text + "\n# later\n")
    done = run("changes", moved["may"], moved["june"])
    assert done.exit_code == 2
    assert "cell.toml is changed since; give it with --cell" in done.stderr
    done = run("changes", moved["may"], moved["june"], "--cell", tmp_path / "cell.toml")
    assert done.exit_code == 0, done.output
