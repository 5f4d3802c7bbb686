"""The error expected at the targets: one figure in five commands, its budget, and a tolerance."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.cell.targets import targets_of
from studies.render import mm
from studies.results.expected import ExpectedErrors
from tests import plain_day as days
from tests.studies.command_line import ran, result

MORE = """
[acceptance]
tolerance_mm = 0.08
[report]
serial = "R-0815"
operator = "second shift"
"""


def _numbers(result: Path) -> dict[str, float]:
    """What is expected at the targets, mm, by the JSON of a result."""
    expected = json.loads(result.read_text())["expected"]
    return {name: value for name, value in expected.items() if name.endswith("_mm")}


def test_five_commands_state_the_same_three_numbers(demo_folder: Path, tmp_path: Path) -> None:
    cell = calib.load_cell(demo_folder / "cell.toml")
    identified = _numbers(demo_folder / "identify.json")
    table, check = demo_folder / "measurements.csv", demo_folder / "check.csv"
    _, said = result(tmp_path / "e.json", "enough", cell.path, table, "--holdout", check)
    assert _numbers(tmp_path / "e.json") == pytest.approx(identified)
    sources = ("parameters", "arm", "model")
    parts = ", ".join(f"{name} {mm(identified[f'{name}_mm'])}" for name in sources)
    assert f"RMS, {mm(identified['worst_mm'])} at worst: {parts}" in said
    assert parts in (demo_folder / "report.html").read_text()
    targets, weights = targets_of(cell)
    corrected = calib.compensate(cell, demo_folder / "identify.json", targets, weights=weights)
    there = ExpectedErrors.of(corrected.error, weights)
    for name, value in identified.items():
        assert getattr(there, name) == pytest.approx(value, rel=0.01)
    diagnosed = _numbers(demo_folder / "diagnose.json")
    beside = [np.hypot(one["arm_mm"], one["model_mm"]) for one in (diagnosed, identified)]
    assert beside[0] < 0.1 * beside[1], "its cause is in the model by then"


def test_a_plan_states_what_its_covariance_leaves(demo_folder: Path) -> None:
    stated = json.loads((demo_folder / "design.json").read_text())
    assert stated["expected"]["parameters_mm"] == pytest.approx(stated["task_rms_mm"])
    assert (stated["expected"]["arm_mm"], stated["expected"]["model_mm"]) == (0.0, 0.0)


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """The folder, the JSON and the terminal of a cell with a tolerance."""
    folder, rng = tmp_path_factory.mktemp("day"), np.random.default_rng(4)
    q = days.joints(24, rng)
    (folder / "data.csv").write_text(days.table(q, days.read(days.points(days.TRUE, q), rng)))
    cell = days.write_cell(folder, more=days.PAYLOAD + MORE)
    call = ("identify", cell, folder / "data.csv", "--holdout", 0.25)
    return folder, *result(folder / "judged.json", *call)


def test_rows_of_the_budget_add_up_to_the_total(
    identified: tuple[Path, dict[str, Any], str],
) -> None:
    _, fields, _ = identified
    rows, budget = fields["budget"]["rows"], fields["budget"]
    squares = [row["at_targets_mm"] ** 2 for row in rows]
    assert math.sqrt(sum(squares)) == pytest.approx(budget["total"]["standard_uncertainty_mm"])
    assert budget["total"]["standard_uncertainty_mm"] == pytest.approx(fields["expected"]["rms_mm"])
    assert sum(row["share"] for row in rows) == pytest.approx(1.0)
    parameters = pytest.approx(fields["expected"]["parameters_mm"])
    assert budget["calibration"]["standard_uncertainty_mm"] == parameters == fields["task_rms_mm"]
    for own in fields["parameters"]:
        low, high = own["ci95"]
        assert high - low == pytest.approx(2.0 * 1.95996 * own["std"], rel=1e-4)


def test_tolerance_and_what_the_cell_tells_reach_result_and_page(
    identified: tuple[Path, dict[str, Any], str],
) -> None:
    folder, fields, told = identified
    held = [
        math.hypot(row["x_mm"], row["y_mm"], row["z_mm"])
        for row in fields["residuals"]
        if row["heldout"]
    ]
    assert fields["acceptance"]["largest_mm"] == pytest.approx(max(held))
    verdict = "pass" if max(held) <= 0.08 else "fail"
    assert fields["acceptance"]["verdict"] == verdict
    assert f"{verdict.capitalize()} (tolerance 0.0800 mm): the largest error of" in told
    assert fields["about"] == {"serial": "R-0815", "operator": "second shift"}
    ran("report", folder / "judged.json", "-o", folder / "page.html")
    text = (folder / "page.html").read_text()
    for words in (*fields["about"].values(), "Tolerance 0.08 mm: the largest error"):
        assert words in text
    said = ran("identify", folder / "cell.toml", folder / "data.csv")
    assert "Not decided (tolerance 0.0800 mm)" in said
