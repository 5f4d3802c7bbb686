"""One rule for the degrees of freedom behind a covariance."""

from __future__ import annotations

import numpy as np
import pytest

from calib.change import COORDINATES
from calib.inference.coverage import freedom


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
