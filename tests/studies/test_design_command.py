"""``posecal design`` as a user and an outside check see it."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import calib
from doe.criteria import CRITERIA, UNASKED
from tests.studies.command_line import paper_cell, run

OPTIONS = ("--candidates", 2000, "--levels", "A2=-140,-99.85,-56.9,-25.24,-0.01x3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's cell with its elastostatic model."""
    path = tmp_path_factory.mktemp("cell")
    paper_cell(path, "stiffness_vs_angle:A2", "joint_compliance:A3,A4,A5,A6")
    return path


@pytest.fixture(scope="module")
def done(folder: Path) -> Result:
    return run(
        "design", folder / "cell.toml", *OPTIONS, "--against", folder / "plan.csv", "--curve",
        "-o", folder / "best.csv", "--json", folder / "best.json",
    )  # fmt: skip


@pytest.fixture(scope="module")
def fields(folder: Path, done: Result) -> dict[str, Any]:
    assert done.exit_code == 0, done.output
    return json.loads((folder / "best.json").read_text(), parse_constant=pytest.fail)


@pytest.mark.long
def test_plan_is_read_by_the_other_commands(folder: Path, fields: dict[str, Any]) -> None:
    cell = calib.load_cell(folder / "cell.toml")
    plan = calib.load_plan(cell, folder / "best.csv")
    assert plan.names == tuple(pose["pose"] for pose in fields["poses"])
    shown = [list(pose["joints_deg"].values()) for pose in fields["poses"]]
    np.testing.assert_allclose(np.degrees(plan.q), shown, atol=1e-9)
    with (folder / "best.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["level"]) for row in rows] == [pose["level"] for pose in fields["poses"]]
    assert all(re.fullmatch(r"-?\d+(\.\d{1,2})?", row["A4_deg"]) for row in rows)


@pytest.mark.long
def test_tables_say_what_matters(done: Result) -> None:
    text = " ".join(done.output.split())
    for said in (
        "15 poses. Expected error at the targets",
        "Taken for granted: a model that lacks nothing, an arm that repeats exactly; 200 poses spread",
        "no plan is below",
        "plan.csv",
        "Loss:",
        "p15",
        "9 parameters",
    ):
        assert said in text, said
    assert "nan" not in text.lower()
    assert max(len(line) for line in done.output.splitlines() if "wrote" not in line) <= 110


@pytest.mark.long
def test_a_plan_found_is_its_own_equal(folder: Path, fields: dict[str, Any]) -> None:
    """Judged beside a new design of the same candidates it has the value it was given.

    Of two plans of one name both are judged.
    """
    (folder / "other").mkdir(exist_ok=True)
    (folder / "other" / "plan.csv").write_text((folder / "plan.csv").read_text())
    plans = [folder / "best.csv", folder / "plan.csv", folder / "other" / "plan.csv"]
    flags = [word for plan in plans for word in ("--against", plan)]
    found = run("design", folder / "cell.toml", *OPTIONS, *flags, "--json", "-")
    again = json.loads(found.stdout)
    rival = again["against"][str(folder / "best.csv")]
    assert rival["value"] == pytest.approx(fields["value"], rel=1e-6)
    assert rival["efficiency"] <= 1.0
    assert again["value"] == pytest.approx(fields["value"], rel=1e-12)
    assert set(again["against"]) == {str(plan) for plan in plans}


@pytest.mark.long
def test_result_holds_what_the_contract_names(folder: Path, fields: dict[str, Any]) -> None:
    assert (fields["schema"], fields["command"], fields["seed"]) == (1, "design", 0)
    named = {Path(entry["file"]).name: entry["sha256"] for entry in fields["inputs"]}
    assert set(named) == {"cell.toml", "kr270.urdf", "plan.csv"}
    assert named["plan.csv"] == hashlib.sha256((folder / "plan.csv").read_bytes()).hexdigest()
    assert fields["criterion"] == "task"
    assert fields["value"] >= fields["bound"] > 0.0
    assert fields["efficiency"] == pytest.approx((fields["bound"] / fields["value"]) ** 2)
    assert fields["value"] == pytest.approx(fields["task_rms_mm"], rel=1e-5)
    assert len(fields["poses"]) == 15
    for pose in fields["poses"]:
        assert set(pose["joints_deg"]) == {f"A{k}" for k in range(1, 7)}
        assert pose["level"] == pytest.approx(pose["joints_deg"]["A2"])
    assert fields["levels_deg"] == {"A2": [-140.0, -99.85, -56.9, -25.24, -0.01]}
    assert [p["name"] for p in fields["predicted_std"]][:2] == [
        "compliance@-140",
        "compliance@-99.85",
    ]
    assert all(p["unit"] == "urad/(N m)" and p["std"] > 0 for p in fields["predicted_std"])
    candidates = fields["candidates"]
    assert candidates["drawn"] == candidates["feasible"] == 2000
    assert fields["seconds"] > 0.0
    assert fields["against"]["plan.csv"]["poses"] == 15
    assert [step["poses"] for step in fields["curve"]] == [5, 10, 15, 20, 25, 30]


def test_help_names_every_criterion() -> None:
    shown = run("design", "--help").output
    _, described = shown.split("--criterion NAME")
    words = re.findall(r"[\w-]+(?=:)", described.split("--levels")[0])
    assert set(CRITERIA) - {UNASKED} <= set(words)
