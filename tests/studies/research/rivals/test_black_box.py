"""Regression of residuals: its axes, its test for a gap, and a case that it can learn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("sklearn")

import calib
from studies.research.rivals.black_box import black_box, improves
from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import Case, draw_scene
from studies.research.withheld.keys import write_case
from studies.research.withheld.robots import LIGHT
from tests.studies.research.withheld.scenes import PLAIN, case_of


def data_of(count: int = 90) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs, noise, and configurations of two readings each."""
    rng = np.random.default_rng(0)
    X = np.repeat(rng.normal(size=(count // 2, 5)), 2, axis=0)
    return X, rng.normal(size=(count, 6)), np.repeat(np.arange(count // 2), 2)


def test_noise_is_no_gap_and_a_curve_is() -> None:
    X, noise, configuration = data_of()
    assert not improves(X, noise, configuration)
    curve = np.outer(np.sin(1.5 * X[:, 2]), np.ones(6))
    assert improves(X, noise * 0.5 + curve, configuration)


def answered(folder: Path, case: Case) -> dict[str, Any]:
    write_case(folder, case)
    cell = calib.load_cell(folder / "cell.toml")
    tables = [
        calib.load_measurements(cell, folder / f"{n}.csv") for n in ("measurements", "heldout")
    ]
    return black_box(cell, *calib.in_one_session(*tables))


@pytest.mark.long
def test_drift_is_learnt_and_the_rest_told(tmp_path: Path) -> None:
    """An instrument that runs away in time: smooth in one column, so any regression must see it."""
    many = replace(PLAIN, configurations=45)
    scene = draw_scene(np.random.default_rng(0), LIGHT, many)
    case = case_of(scene, Cause("tracker_drift", "instrument", {"x": 4e-4, "z": -4e-4}))
    noise = np.random.default_rng(0).normal(size=case.noisy.shape) * scene.noise.sigma
    found = answered(tmp_path / "drift", replace(case, noisy=case.clean + noise))
    assert found["verdict"] == "unknown"
    assert found["effects"] == []
    assert found["gap"]["heldout_after_mm"] < 0.5 * found["gap"]["heldout_before_mm"]
    scene = draw_scene(np.random.default_rng(0), LIGHT, PLAIN)
    still = case_of(scene)
    noise = np.random.default_rng(0).normal(size=still.noisy.shape) * scene.noise.sigma
    nothing = answered(tmp_path / "still", replace(still, noisy=still.clean + noise))
    assert nothing["verdict"] == "no_gap"
    assert nothing["gap"]["heldout_after_mm"] == nothing["gap"]["heldout_before_mm"]
