"""The budget against days that are simulated by other code, and against a sheet worked by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.inference.coverage import coverage_factor, effective_freedom
from calib.poses import poses_at
from calib.prediction.budget import budget_of
from calib.prediction.estimate import estimate_of
from tests.calib.prediction import arm_days as days

DAYS = 1000
TARGETS = days.joints(12, np.random.default_rng(77))


def test_total_and_intervals_hold_over_a_thousand_days(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    q = days.joints(18, rng)
    true = days.points(days.TRUE, q)
    (tmp_path / "data.csv").write_text(days.table(q, days.read(true, rng)))
    cell = calib.load_cell(days.write_cell(tmp_path))
    found = calib.identify(cell, calib.load_measurements(cell, tmp_path / "data.csv"))
    budget = budget_of(found, estimate_of(found), poses_at(TARGETS), np.ones(len(TARGETS)))
    expected = budget.expected
    gain = days.slopes(days.TRUE, TARGETS) @ np.linalg.pinv(days.slopes(days.TRUE, q))
    off = np.array([days.read(true, rng) - true for _ in range(DAYS)]).reshape(DAYS, -1)
    missed = (off @ gain.T).reshape(DAYS, len(TARGETS), 3, 3)
    errors = np.sqrt((missed**2).sum(axis=-1).mean(axis=-1))
    assert budget.rms(expected.errors) == pytest.approx(np.sqrt((errors**2).mean()), rel=0.05)
    np.testing.assert_allclose(expected.errors, np.sqrt((errors**2).mean(axis=0)), rtol=0.08)
    held = (errors <= expected.expanded).mean(axis=0)
    assert held.mean() == pytest.approx(0.95, abs=0.015)
    assert np.abs(held - 0.95).max() < 0.03


def test_the_gauge_block_of_the_guide() -> None:
    """JCGM 100, H.1: five influences, 16.7 degrees of freedom, t of 99 % 2.92 at 16, U = 93 nm."""
    parts = [(25.0**2, 18.0), (9.7**2, 25.6), (2.9**2, 50.0), (16.6**2, 2.0)]
    nu = float(effective_freedom(parts))
    assert nu == pytest.approx(16.7, abs=0.2)
    factor = float(coverage_factor(np.floor(nu), level=0.99))
    assert factor == pytest.approx(2.92, abs=0.005)
    assert factor * np.sqrt(sum(v for v, _ in parts)) == pytest.approx(93.0, abs=1.0)


def test_coverage_in_space() -> None:
    """95 % of the lengths of a normal error in space lie within 2.795 standard deviations."""
    each = float(coverage_factor(np.inf, 3.0)) * np.sqrt(3.0)
    assert each == pytest.approx(2.7955, abs=1e-3)
