"""``posecal identify`` as a user and an outside check see it."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from tests.helpers import measured_cell
from tests.studies.command_line import run


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = measured_cell(tmp_path_factory.mktemp("demo"))
    done = run(
        "identify", folder / "cell.toml", folder / "measurements.csv",
        "--json", folder / "result.json", "--urdf", folder / "kr270_calibrated.urdf",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def fields(demo: Path) -> dict[str, Any]:
    return json.loads((demo / "result.json").read_text())


def test_result_holds_what_the_contract_names(demo: Path, fields: dict[str, Any]) -> None:
    assert fields["schema"] == 1
    assert fields["command"] == "identify"
    assert fields["seed"] == 0
    for entry in fields["inputs"]:
        assert entry["sha256"] == hashlib.sha256(Path(entry["file"]).read_bytes()).hexdigest()
    assert fields["status"] == "converged"
    assert fields["rank"] == len(fields["parameters"]) == 42
    assert {"sigma_mm", "believed_sigma_mm", "source"} <= set(fields["noise"])
    assert {"name", "effect", "where", "value", "std", "unit"} <= set(fields["parameters"][0])
    keys = {"nominal", "fitted", "fitted_all", "heldout", "heldout_trimmed"}
    for name in ("rms_mm", "max_mm", "p95_mm"):
        assert set(fields[name]) == keys
        assert fields[name]["heldout"] is None
    assert len(fields["residuals"]) == 90
    knots = [p["name"] for p in fields["parameters"] if p["effect"] == "stiffness_vs_angle"]
    assert knots[0] == "compliance@-140"


def test_base_and_markers_predict_the_readings(demo: Path, fields: dict[str, Any]) -> None:
    """The parameters of the JSON, in SI, are the values that ``calib.predict`` takes."""
    cell = calib.load_cell(demo / "cell.toml")
    data = calib.load_measurements(cell, demo / "measurements.csv")
    scale = {"mm": 1e-3, "mrad": 1e-3, "um": 1e-6, "urad": 1e-6, "urad/(N m)": 1e-6}
    values = {p["id"]: p["value"] * scale[p["unit"]] for p in fields["parameters"]}
    error = data.points - calib.predict(cell, data, values)
    rms = 1e3 * math.sqrt(np.mean(np.sum(error**2, axis=-1)))
    assert rms == pytest.approx(fields["rms_mm"]["fitted"], rel=1e-6)
    residuals = np.array([[r["x_mm"], r["y_mm"], r["z_mm"]] for r in fields["residuals"]])
    np.testing.assert_allclose(error.reshape(-1, 3) * 1e3, residuals, atol=1e-6)
    translation = [values[f"base:base.{c}"] * 1e3 for c in "xyz"]
    np.testing.assert_allclose(fields["base"]["translation_mm"], translation)


def test_json_to_standard_output_is_json_alone(demo: Path) -> None:
    done = run("identify", demo / "cell.toml", demo / "measurements.csv", "--json", "-")
    assert json.loads(done.stdout)["status"] == "converged"
    assert "42 of 42 parameters" in done.stderr


def test_holdout_by_fraction_and_by_file(demo: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.json"
    cell, table = demo / "cell.toml", demo / "measurements.csv"
    assert run("identify", cell, table, "--holdout", "0.2", "--json", out).exit_code == 0
    first = json.loads(out.read_text())
    assert first["rms_mm"]["heldout"] > 0
    assert sum(r["heldout"] for r in first["residuals"]) == 3 * 2 * 3
    run("identify", cell, table, "--holdout", "0.2", "--seed", "5", "--json", out)
    assert json.loads(out.read_text())["rms_mm"] != first["rms_mm"], "the seed decides"
    assert "holds the data themselves" in run("identify", cell, table, "--holdout", table).stderr
    copy = tmp_path / "copy.csv"
    copy.write_text(table.read_text())
    assert run("identify", cell, table, "--holdout", copy, "--json", out).exit_code == 0
    both = json.loads(out.read_text())
    assert both["rms_mm"]["heldout"] == pytest.approx(both["rms_mm"]["fitted"])
    assert len(both["inputs"]) == 4


def test_corrected_urdf_is_the_nominal_model_of_the_next_run(demo: Path, tmp_path: Path) -> None:
    """The geometry that is left is within its uncertainty, and can be corrected again."""
    (tmp_path / "kr270.urdf").write_text((demo / "kr270_calibrated.urdf").read_text())
    (tmp_path / "cell.toml").write_text((demo / "cell.toml").read_text())
    out, urdf = tmp_path / "r.json", tmp_path / "again.urdf"
    cell, table = tmp_path / "cell.toml", demo / "measurements.csv"
    done = run("identify", cell, table, "--json", out, "--urdf", urdf)
    assert done.exit_code == 0, done.output
    again = json.loads(out.read_text())
    left = [p for p in again["parameters"] if p["effect"] == "geometry"]
    assert max(abs(p["value"]) / p["std"] for p in left) < 0.05
    assert urdf.read_text().count('link name="marker_m1"') == 1
