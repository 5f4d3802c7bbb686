"""Tables II to IV of the paper from a simulated campaign."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import calib
from studies.demo.embedded import embedded_plan
from studies.research.paper import elastostatic
from studies.research.paper.elastostatic import KNOWN, MICRO, NAMES

PAPER = json.loads((Path(__file__).parents[3] / "reference" / "paper.json").read_text())


@pytest.fixture(scope="module")
def campaign() -> tuple[calib.Measurements, calib.Cell, np.ndarray, list[int]]:
    cell = elastostatic.cell_of_section_five("base", "tool")
    data, model, truth = elastostatic.measured(cell)
    return data, cell, truth, elastostatic.compliances(model)


def test_embedded_figures_are_those_printed() -> None:
    own, four = elastostatic.tables(), PAPER["table_IV"]
    angles = ("-0.01", "-25.24", "-56.9", "-99.85", "-140")
    rest = ("A3", "A4", "A5", "A6")
    assert own["compliance"] == [four["A2_at_deg"][a] for a in angles] + [four[j] for j in rest]
    printed = four["interval"]
    assert own["interval"] == [printed["A2_at_deg"][a] for a in angles] + [printed[j] for j in rest]


def test_both_solvers_find_table_four(
    campaign: tuple[calib.Measurements, calib.Cell, np.ndarray, list[int]],
) -> None:
    data, cell, truth, order = campaign
    found = elastostatic.identified(data, cell)
    joint, turns = found["joint"], found["two-step"]
    np.testing.assert_allclose(turns.values, joint.values, atol=1e-6 * joint.std.max(), rtol=1e-6)
    for result in found.values():
        error = (result.values - truth) / result.std
        assert np.abs(error[order]).max() < 4.0
        assert result.noise.source == "cell"
    base = (joint.values - truth)[:6] / joint.std[:6]
    assert np.abs(base).max() < 4.0, "Table III"


def test_intervals_fix_the_unit() -> None:
    """Printed over predicted of chi_21 .. chi_4 is near one at 1e-6 rad/(N m), and nowhere else."""
    cell = elastostatic.cell_of_section_five()
    printed = np.array(elastostatic.tables()["interval"])
    for com in ((0.3, 0.0, 0.15), (0.1, 0.2, -0.3), (0.5, -0.3, 0.2)):
        std = elastostatic.predicted(np.array(com), embedded_plan(cell), cell)
        ratio = (printed * MICRO / std)[KNOWN]
        assert ratio.min() > 0.4
        assert ratio.max() < 2.5


def test_the_last_joints_depend_on_the_load_point() -> None:
    cell = elastostatic.cell_of_section_five()
    plan = embedded_plan(cell)
    near = elastostatic.predicted(np.array([0.3, 0.0, 0.05]), plan, cell)
    far = elastostatic.predicted(np.array([0.3, 0.0, 0.4]), plan, cell)
    ratio = near / far
    assert ratio[8] > 3.0
    assert ratio[KNOWN].max() < 1.3
    with np.errstate(invalid="ignore", divide="ignore"):
        on_axis = elastostatic.predicted(np.array([0.3, 0.0, 0.0]), plan, cell)
    assert not on_axis[8] <= 1e3 * far[8]


def test_printed_tables() -> None:
    done = CliRunner().invoke(elastostatic.main, [])
    assert done.exit_code == 0, done.output
    for name in NAMES:
        assert sum(line.startswith(name) for line in done.output.splitlines()) == 2, name
    assert "1e-6 rad/(N m)" in done.output
