"""Budget, acceptance and certificate as a user sees them: in the JSON, on the terminal, on the page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from tests.calib.prediction import arm_days as days
from tests.studies.command_line import result, run

Told = dict[str, tuple[dict[str, Any], str]]
MORE = """
[acceptance]
tolerance_mm = 0.08
[report]
serial = "R-0815"
operator = "A. Meier"
date = 2026-11-22
gripper = "old one"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    import numpy as np

    folder = tmp_path_factory.mktemp("day")
    rng = np.random.default_rng(4)
    q = days.joints(24, rng)
    (folder / "data.csv").write_text(days.table(q, days.read(days.points(days.TRUE, q), rng)))
    days.write_cell(folder)
    (folder / "silent.toml").write_text((folder / "cell.toml").read_text())
    (folder / "stated.toml").write_text((folder / "cell.toml").read_text() + MORE)
    return folder


@pytest.fixture(scope="module")
def both(folder: Path) -> Told:
    """The JSON and the terminal of a cell with and without a tolerance and a report."""
    return {
        cell: result(folder / f"{cell}.json", "identify", f"{folder / cell}.toml",
                     folder / "data.csv", "--holdout", 0.25)
        for cell in ("stated", "silent")
    }  # fmt: skip


def test_rows_add_up_to_the_total_and_absent_keys_change_nothing(both: Told) -> None:
    fields, silent = both["stated"][0], both["silent"][0]
    rows, budget = fields["budget"]["rows"], fields["budget"]
    squares = [row["at_targets_mm"] ** 2 for row in rows]
    assert math.sqrt(sum(squares)) == pytest.approx(budget["total"]["standard_uncertainty_mm"])
    assert sum(row["share"] for row in rows) == pytest.approx(1.0)
    assert budget["calibration"]["standard_uncertainty_mm"] == pytest.approx(fields["task_rms_mm"])
    (row,) = rows
    assert row["source"] == "noise of the readings"
    own = row["sensitivity_mm"] * row["standard_uncertainty"]
    assert own == pytest.approx(row["at_targets_mm"])
    assert silent["budget"] == budget
    assert silent["parameters"] == fields["parameters"]
    assert silent["acceptance"] is None
    assert silent["about"] == {}
    for parameter in fields["parameters"]:
        low, high = parameter["ci95"]
        assert high - low == pytest.approx(2.0 * 1.95996 * parameter["std"], rel=1e-4)


def test_tolerance_and_what_the_cell_tells_reach_result_and_page(folder: Path, both: Told) -> None:
    fields, told = both["stated"]
    held = [
        math.dist((row["x_mm"], row["y_mm"], row["z_mm"]), (0, 0, 0))
        for row in fields["residuals"]
        if row["heldout"]
    ]
    found = fields["acceptance"]
    assert found["largest_mm"] == pytest.approx(max(held))
    verdict = "pass" if max(held) <= 0.08 else "fail"
    assert found["verdict"] == verdict
    assert f"{verdict.capitalize()} (tolerance 0.0800 mm): the largest error of" in told
    about = {"serial": "R-0815", "operator": "A. Meier", "date": "2026-11-22", "gripper": "old one"}
    assert fields["about"] == about
    page = folder / "page.html"
    done = run("report", folder / "stated.json", "-o", page)
    assert done.exit_code == 0, done.output
    text = page.read_text()
    for words in about.values():
        assert words in text
    assert "Tolerance 0.08 mm: the largest error" in text


def test_without_poses_held_out_nothing_is_judged(folder: Path) -> None:
    done = run("identify", folder / "stated.toml", folder / "data.csv")
    assert "Not decided (tolerance 0.0800 mm)" in " ".join(done.stdout.split())
