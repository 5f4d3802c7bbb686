"""Points against a tolerance: by hand, and against readings that other code makes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cell.cell import Acceptance
from calib.change import COORDINATES
from calib.uncertainty.acceptance import ConformityTest, judged
from calib.uncertainty.expanded import freedom
from tests.calib.uncertainty import common_days as days


def test_guard_band_by_hand() -> None:
    distances, U = np.array([0.06, 0.08, 0.12, 0.14]) * 1e-3, np.full(4, 0.03e-3)
    guarded, simple = Acceptance(0.1e-3, "guarded"), Acceptance(0.1e-3, "simple")
    assert guarded.judge(distances, U) == ["pass", "undecided", "undecided", "fail"]
    assert simple.judge(distances, U) == ["pass", "pass", "fail", "fail"]
    told = [ConformityTest(guarded, distances[:n], U[:n], tuple(guarded.judge(distances[:n], U[:n])))
            for n in (0, 1, 3, 4)]  # fmt: skip
    assert [own.verdict for own in told] == [None, "pass", "undecided", "fail"]


@pytest.fixture(scope="module", params=["", days.COMMON], ids=["alone", "with common errors"])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("day")
    rng = np.random.default_rng(11)
    q, day = days.joints(24, rng), days.drawn(rng, "none")
    table = days.table(q, days.read(days.points(days.TRUE, q), day, rng))
    (folder / "data.csv").write_text(table)
    days.write_cell(folder, request.param)
    return folder


def test_uncertainty_of_a_reading_holds_what_readings_are_off(folder: Path) -> None:
    """On days of a tracker of its own, 95 of 100 readings are within it; by the tolerance a point at
    its very limit passes half the time by simple acceptance, and hardly ever by the guarded rule.
    """
    cell = replace(calib.load_cell(folder / "cell.toml"), acceptance=Acceptance(1e-3, "guarded"))
    data = calib.load_measurements(cell, folder / "data.csv")
    fitted, heldout = data.take(slice(0, 18)), data.take(slice(18, None))
    assert judged(cell, calib.identify(cell, fitted)).verdict is None
    found = judged(cell, calib.identify(cell, fitted, heldout=heldout))
    assert found is not None
    assert found.verdict == "pass"
    true = days.points(days.TRUE, heldout.poses.q)
    rng, off, limit = np.random.default_rng(2), [], {"simple": [], "guarded": []}
    common = bool(cell.tracker.common)
    for _ in range(1000):
        day = days.drawn(rng, "" if common else "none")
        wrong = (days.read(true, day, rng) - true).reshape(-1, 3)
        off.append(np.linalg.norm(wrong, axis=-1))
        away = rng.standard_normal(wrong.shape)
        there = 1e-3 * away / np.linalg.norm(away, axis=-1, keepdims=True)
        seen = np.linalg.norm(there + wrong, axis=-1)
        for rule, passed in limit.items():
            verdicts = Acceptance(1e-3, rule).judge(seen, found.expanded)  # type: ignore[arg-type]
            passed += [verdict == "pass" for verdict in verdicts]
    assert (np.array(off) <= found.expanded).mean() == pytest.approx(0.95, abs=0.01)
    assert np.mean(limit["simple"]) == pytest.approx(0.5, abs=0.05)
    assert np.mean(limit["guarded"]) < 0.025


# -- One rule for the degrees of freedom behind a covariance ---------------------------------------


def test_stays_count_where_poses_err_as_a_whole() -> None:
    assert freedom(np.inf, 20, 30, as_a_whole=False) == np.inf
    assert freedom(50.0, 20, 30, as_a_whole=True) == pytest.approx(15.0)
    assert freedom(50.0, 4, 30, as_a_whole=True) == 1.0
    assert freedom(0.0, 4, 30, as_a_whole=False) == 1.0


def test_the_rule_covers_a_variance_of_whole_poses() -> None:
    """Stays of six numbers, variances that differ: an interval by the rule covers 95 % or more."""
    from scipy.stats import t

    rng, stays, p, held = np.random.default_rng(0), 15, 12, 0
    trials = 2000
    for _ in range(trials):
        J = rng.normal(size=(6 * stays, p))
        sizes = np.repeat(rng.chisquare(4, size=(1, 6)) / 4.0, stays, axis=0).ravel()
        y = rng.normal(size=6 * stays) * np.sqrt(sizes)
        W = J / np.sqrt(sizes)[:, None]
        values, *_ = np.linalg.lstsq(W, y / np.sqrt(sizes), rcond=None)
        r = y / np.sqrt(sizes) - W @ values
        s = np.sqrt(r @ r / (6 * stays - p))
        half = t.ppf(0.975, freedom(np.inf, stays, p, as_a_whole=True))
        std = s * np.sqrt(np.linalg.inv(W.T @ W)[0, 0])
        held += abs(values[0]) <= half * std
    assert 0.95 <= held / trials <= 0.985


def test_two_days_are_compared_with_more_caution() -> None:
    few = freedom(np.inf, 20, 30, as_a_whole=True, numbers=COORDINATES)
    assert few == pytest.approx(10.0)
    assert few < freedom(np.inf, 20, 30, as_a_whole=True)
