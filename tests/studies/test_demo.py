"""The demonstration goes the whole way, and leaves files to go on from."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from calib import Cell, Poses
from studies.demo.embedded import embedded_cell, embedded_plan, session
from tests.helpers import simulated
from tests.studies.command_line import run


def test_it_names_what_it_wrote_and_the_next_commands_run(demo_folder: Path) -> None:
    said = (demo_folder.parent / "said").read_text()
    named = said[said.index(" holds:") : said.index("Try next")]
    files = re.findall(r"\b[\w]+\.(?:toml|urdf|csv|json|html)\b", named)
    assert len(files) >= 9
    for name in files:
        assert (demo_folder / name).is_file(), name
    steps = [line.split() for line in said.splitlines() if line.startswith("  posecal ")]
    assert len(steps) == 3
    for step in steps:
        assert run(*step[1:], "--help").exit_code == 0
        given = [word for word in step if word.startswith(str(demo_folder))]
        assert all(Path(word).exists() for word in given[:2])
    again = run(*steps[0][1:])
    assert again.exit_code == 0, again.output


def test_the_withheld_effect_is_found(demo_folder: Path) -> None:
    truth = json.loads((demo_folder / "truth.json").read_text())
    found = json.loads((demo_folder / "diagnose.json").read_text())
    assert found["verdict"] == "explained"
    assert [f"{e['effect']}:{e['where']}" for e in found["effects"]] == [truth["withheld"]]
    for p in found["effects"][0]["parameters"]:
        name = f"{truth['withheld']}.{p['name']}"
        assert abs(p["value"] - truth["parameters"][name]["value"]) < 4.0 * p["std"]
    assert truth["withheld"] not in (demo_folder / "cell.toml").read_text()
    kind = truth["withheld"].split(":")[0]
    assert kind in (demo_folder / "better_cell.toml").read_text()


def test_another_seed_hides_another_effect() -> None:
    cell = embedded_cell()
    days = [session(cell, embedded_plan(cell), seed) for seed in range(6)]
    assert len({day.withheld for day in days}) > 1
    assert all(day.withheld for day in days)


@pytest.mark.parametrize("name", ["cell.toml", "measurements.csv", "identify.json"])
def test_what_was_edited_is_kept(demo_folder: Path, tmp_path: Path, name: str) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(demo_folder, folder)
    file = folder / name
    file.write_text(file.read_text() + "\n")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    done = run("demo", folder)
    assert done.exit_code == 2
    assert f"{name}: is no file of an earlier demo, or was edited; it is kept" in done.stderr
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


# -- The embedded example against the paper's printed tables ---------------------------------------


PAPER = json.loads((Path(__file__).parent.parent / "reference" / "paper.json").read_text())


def test_plan_and_markers_are_those_printed(kr270: Cell, table_two: Poses) -> None:
    np.testing.assert_allclose(np.degrees(table_two.q), PAPER["table_II_deg"], atol=1e-9)
    markers = list(PAPER["table_III_markers_mm"].values())
    np.testing.assert_allclose(kr270.markers * 1e3, markers, atol=1e-9)


def test_truth_is_table_four(kr270: Cell, table_two: Poses) -> None:
    _, model, truth = simulated(kr270, table_two, 0)
    printed = PAPER["table_IV"]
    for p, value in zip(model.parameters, truth, strict=True):
        if p.effect == "joint_compliance":
            assert value / p.scale == pytest.approx(printed[p.where])
        if p.effect == "stiffness_vs_angle":
            knot = p.name.removeprefix("compliance@")
            assert value / p.scale == pytest.approx(printed["A2_at_deg"][knot])
