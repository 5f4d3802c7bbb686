"""What remains beside the causes, on days of an arm in MuJoCo that lacks nothing but repeatability."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.diagnosis import Diagnosis
from studies.research.benchmarks.day import Setting, draw_day, write_day

pytest.importorskip("mujoco")


def diagnosed(folder: Path, scatter: float, approaches: int = 1, robot: str = "") -> Diagnosis:
    """A day of an arm that scatters by so much (3-D, m); robot : lines more for its cell."""
    day = draw_day(Setting("6R", scatter, approaches, 40 // approaches, 3), 1, 5)
    write_day(folder, day)
    text = (folder / "cell.toml").read_text()
    (folder / "cell.toml").write_text(text.replace("[robot]", f"[robot]\n{robot}"))
    cell = calib.load_cell(folder / "cell.toml")
    return calib.diagnose(cell, calib.load_measurements(cell, folder / "measurements.csv"))


def test_scatter_that_such_arms_have_is_no_gap(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 3e-5)
    assert found.verdict == "no_gap"
    assert not found.located
    assert (found.rest.kind, found.rest.of) == ("scatter", "undecided")
    assert found.rest.source == "assumed"
    assert found.rest.size == pytest.approx(3e-5 / np.sqrt(3.0), rel=0.4)


def test_second_approaches_tell_that_it_is_the_arm(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 3e-5, approaches=2)
    assert found.verdict == "no_gap"
    assert (found.rest.kind, found.rest.of, found.rest.source) == ("scatter", "arm", "measured")


def test_no_arm_scatters_as_much(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 3e-4)
    assert found.verdict == "unknown"
    assert (found.rest.kind, found.rest.of) == ("too_large", "model")
    assert [(place.where, place.depends_on) for place in found.located][-1][1] == "pose"


def test_more_than_the_cell_says_is_the_model_s(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 1e-4, robot="repeatability_mm = 0.005\nrepeatability_urad = 5")
    assert found.verdict == "unknown"
    assert (found.rest.kind, found.rest.of, found.rest.source) == ("too_large", "model", "stated")


def test_nothing_remains_where_the_arm_repeats(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, 0.0)
    assert (found.verdict, found.rest.kind, found.rest.size) == ("no_gap", "none", 0.0)
