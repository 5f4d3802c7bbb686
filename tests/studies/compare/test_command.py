"""``posecal compare`` as a user and an outside check see it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from tests.studies.command_line import paper_cell, run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's cell with its elastostatic model, two poses of its plan at each level, and fewer."""
    path = tmp_path_factory.mktemp("cell")
    paper_cell(path, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
    rows = (path / "plan.csv").read_text().splitlines()
    two = [row for k, row in enumerate(rows[1:]) if k % 3]
    (path / "plan.csv").write_text("\n".join([rows[0], *two, ""]))
    (path / "shorter.csv").write_text("\n".join([rows[0], *rows[1::2], ""]))
    return path


@pytest.fixture(scope="module")
def done(folder: Path) -> Result:
    return run(
        "compare", folder / "cell.toml", folder / "plan.csv", folder / "shorter.csv",
        "--monte-carlo", 100, "--workers", 1, "--json", folder / "out.json",
        "--figures", folder / "figures",
    )  # fmt: skip


@pytest.fixture(scope="module")
def fields(folder: Path, done: Result) -> dict[str, Any]:
    assert done.exit_code == 0, done.output
    return json.loads((folder / "out.json").read_text(), parse_constant=pytest.fail)


def entry(plan: dict[str, Any], approach: str, weighting: str) -> dict[str, Any]:
    found = [
        e for e in plan["approaches"] if (e["approach"], e["weighting"]) == (approach, weighting)
    ]
    assert len(found) == 1
    return found[0]


@pytest.mark.long
def test_figures_are_consistent(fields: dict[str, Any]) -> None:
    for plan in fields["plans"]:
        plain, points = entry(plan, "pose", "plain"), entry(plan, "points", "full")
        for a, b, gain in zip(
            plain["parameters"], points["parameters"], plan["improvement"], strict=True
        ):
            assert gain["factor"] == pytest.approx(a["std"] / b["std"])
            assert b["monte_carlo_std"] == pytest.approx(b["std"], rel=0.3)
        full = entry(plan, "pose", "full")
        assert full["task_rms_mm"] == pytest.approx(points["task_rms_mm"], rel=1e-9)
    whole, half = fields["plans"]
    assert (
        entry(half, "points", "full")["task_rms_mm"] > entry(whole, "points", "full")["task_rms_mm"]
    )
    ratios = [
        p["monte_carlo_std"] / p["std"]
        for plan in fields["plans"] for e in plan["approaches"] for p in e["parameters"]
    ]  # fmt: skip
    worst = fields["agreement"]["worst_ratio"]
    assert any(worst == pytest.approx(r) for r in ratios)


@pytest.mark.long
def test_the_answer_comes_first(done: Result) -> None:
    lines = done.output.splitlines()
    said = " ".join(done.output.split())
    assert said.startswith("kr270 milling cell: Best of 2 plans: plan.csv, with an expected error")
    assert re.search(r"error of [\d.]+ mm RMS from marker points \(#2\)\.", said)
    assert "shorter.csv has to be measured" in said
    assert "100 simulated experiments a plan" in said
    assert "Weighted by its full covariance, #1 equals #2" in said
    assert max(map(len, lines)) <= 120


@pytest.mark.long
def test_figures_are_written(folder: Path, done: Result) -> None:
    assert "2 figures to" in done.output
    made = {path.name for path in (folder / "figures").iterdir()}
    assert made == {"deviations_by_approach.svg", "ellipses.svg"}


@pytest.mark.long
def test_figures_of_a_plan_that_leaves_parameters_open(folder: Path, tmp_path: Path) -> None:
    """What cannot be drawn is left out; the result is not lost with it."""
    rows = (folder / "plan.csv").read_text().splitlines()
    (folder / "few.csv").write_text("\n".join([*rows[:3], ""]))
    done = run(
        "compare", folder / "cell.toml", folder / "few.csv", "--monte-carlo", 20, "--workers", 1,
        "--figures", tmp_path / "figures", "--json", tmp_path / "out.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "few.csv does not determine" in done.output
    stems = {path.stem for path in (tmp_path / "figures").iterdir()}
    assert "deviations_by_approach" in stems
    json.loads((tmp_path / "out.json").read_text(), parse_constant=pytest.fail)


def test_nothing_simulated(folder: Path) -> None:
    done = run(
        "compare", folder / "cell.toml", folder / "plan.csv", "--monte-carlo", 0, "--json", "-"
    )
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout, parse_constant=pytest.fail)
    assert found["trials"] == 0
    assert found["agreement"]["worst_ratio"] is None
    assert found["agreement"]["chi2_p"] is None
    assert found["plans"][0]["approaches"][0]["parameters"][0]["monte_carlo_std"] is None
    assert "Nothing was simulated" in done.stderr
