"""Chances of weighted sums of squares, against chi-square, F and drawn ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, f

from calib.diagnosis.quadratic import chance_above, ratio_above


@pytest.mark.parametrize("k", [1, 2, 4, 12, 60])
def test_equal_weights_are_chi_square(k: int) -> None:
    for p in (0.9, 0.5, 0.1, 0.03, 1e-3, 1e-10):
        found = chance_above(np.full(k, 0.3), 0.3 * float(chi2.isf(p, k)))
        assert found == pytest.approx(p, rel=0.05 if k > 1 else 0.12)


@pytest.mark.parametrize(
    "weights", [[1.0, 0.5, 0.1, 0.02], [1.0, 1e-3, 1e-3], [1.0, 0.8, 0.7, -0.3, -0.4]]
)
def test_unequal_weights_against_drawn_sums(weights: list[float]) -> None:
    drawn = np.random.default_rng(0).normal(size=(400_000, len(weights))) ** 2 @ np.array(weights)
    for p in (0.8, 0.5, 0.1, 0.03, 0.005):
        found = chance_above(np.array(weights), float(np.quantile(drawn, 1.0 - p)))
        assert found == pytest.approx(p, rel=0.06)


def test_shares_of_equal_weights_are_an_F_ratio() -> None:
    k, dof = 4, 90
    for p in (0.5, 0.03, 1e-6):
        F = float(f.isf(p, k, dof - k))
        share = F * k / (dof - k + F * k)
        assert ratio_above(np.ones(k), dof, share * dof) == pytest.approx(p, rel=0.03)
