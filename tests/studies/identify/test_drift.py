"""What ``posecal identify`` says of a reference that was measured again and again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import load_cell, load_plan, readings
from calib.arm.statics import wrench_with_load
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from tests.studies.command_line import paper_cell, result

RATES = np.array([40.0, -60.0, 20.0, 20.0, 0.0, -30.0])  # um/h and urad/h


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's plan with its first pose again at the start, in the middle and at the end."""
    path = tmp_path_factory.mktemp("day")
    paper_cell(path, "base", "tool", "joint_compliance:A2,A3,A4,A5,A6")
    header, *rows = (path / "plan.csv").read_text().splitlines()
    again = [rows[0].replace("p01", f"ref{k}", 1) for k in (1, 2, 3, 4)]
    assert all(row.startswith("ref") for row in again)
    plan = [again[0], *rows[1:6], again[1], *rows[6:11], again[2], *rows[11:], again[3]]
    (path / "plan.csv").write_text("\n".join([header, *plan]) + "\n")
    return path


def measured(folder: Path, rates: np.ndarray, timed: bool = True) -> Path:
    cell = load_cell(folder / "cell.toml")
    poses = readings(cell, load_plan(cell, folder / "plan.csv"))
    poses = replace(
        poses,
        wrench=wrench_with_load(cell.robot, cell.gravity, poses),
        load_mass=np.zeros(len(poses)),
        time=300.0 * np.arange(len(poses)),
    )
    model = build(replace(cell, effects=(*cell.effects, "base_drift")), with_moves(poses)).model
    values = np.zeros(len(model.parameters))
    values[-6:] = rates * 1e-6 / 3600.0
    values[model.where(type(model.effects[4]))] = 1e-6
    data = drawn_readings(model, values, poses, cell.noise, np.random.default_rng(0))
    data = replace(data, poses=replace(data.poses, approach=None))
    if not timed:
        data = replace(data, poses=replace(data.poses, time=None))
    path = folder / "measured.csv"
    path.write_text(measurements_csv(cell, data))
    return path


def identified(folder: Path, data: Path, *more: object) -> tuple[float | None, str]:
    out = folder / "result.json"
    fields, said = result(out, "identify", folder / "cell.toml", data, *more)
    return fields["drift_p"], said


def test_a_still_day(folder: Path) -> None:
    p, said = identified(folder, measured(folder, 0.0 * RATES))
    assert p is not None
    assert p > 0.01
    assert "base_drift" not in said


@pytest.mark.parametrize("timed", [True, False])
def test_a_drifting_day(folder: Path, timed: bool) -> None:
    """Poses that are held out tell of it as those that are fitted."""
    p, said = identified(folder, measured(folder, RATES, timed), "--holdout", "0.3")
    assert p is not None
    assert p < 0.01
    assert "poses read again moved steadily" in " ".join(said.split())
    assert "base_drift" in said


def test_nothing_repeated_says_nothing(folder: Path) -> None:
    data = measured(folder, RATES)
    kept = [
        line
        for line in data.read_text().splitlines()
        if not line.startswith(("ref2", "ref3", "ref4"))
    ]
    data.write_text("\n".join(kept))
    p, said = identified(folder, data)
    assert p is None
    assert "read again" not in said
