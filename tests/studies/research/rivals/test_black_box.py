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
from studies.research.rivals.black_box import black_box, improves, in_base, inputs
from studies.research.withheld.causes import Cause
from studies.research.withheld.draw import Case, draw_case, draw_scene
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


def test_repeats_of_a_configuration_do_not_vouch_for_each_other() -> None:
    """An error of its own in each configuration: two alike readings are no proof of a law."""
    X, noise, configuration = data_of()
    own = np.repeat(noise[::2], 2, axis=0) * 3.0
    assert not improves(X, own + noise * 0.1, configuration)


def test_residuals_stand_in_base_axes(tmp_path: Path) -> None:
    """A marker error known in base axes, read from a turned base; a hidden point errs as the others."""
    case = draw_case(np.random.default_rng([9, 0]), "null")
    write_case(tmp_path / "case", case)
    cell = calib.load_cell(tmp_path / "case" / "cell.toml")
    data = calib.load_measurements(cell, tmp_path / "case" / "measurements.csv")
    fit = calib.identify(cell, data)
    push = np.array([1.0, -2.0, 3.0])
    R, _ = fit.model.placement(fit.values, data.poses)
    seen = data.seen.copy()
    seen[4, 1] = False
    vectors = np.einsum("mij,j->mi", R, push)[:, None] * seen[..., None]
    residuals = replace(fit.fit, data=replace(data, seen=seen), vectors=vectors)
    expected = np.tile(push, seen.shape[1])
    np.testing.assert_allclose(in_base(fit, residuals), np.tile(expected, (len(data), 1)))
    assert inputs(data.poses).shape[0] == len(data)


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
