"""Groups left out: the same errors as by refitting without them."""

from __future__ import annotations

import numpy as np
import pytest

from calib.inference.least_squares import solve
from calib.inference.leave_out import leave_groups_out


@pytest.mark.parametrize("sizes", [[1, 2, 3, 4, 20], [5] * 8])
def test_errors_are_those_of_a_refit(sizes: list[int]) -> None:
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat(np.arange(len(sizes)) * 3, sizes))
    X, y = rng.normal(size=(len(group), 6)), rng.normal(size=len(group))
    found = leave_groups_out(X, y, group)
    assert found.determined.all()
    for own in np.unique(group):
        out = group == own
        values = solve(X[~out], y[~out]).values
        np.testing.assert_allclose(found.residual[out], y[out] - X[out] @ values, rtol=1e-9)


@pytest.mark.parametrize("sizes", [[1, 2, 3, 4, 20], [5] * 8])
def test_predictions_spread_as_the_other_groups_leave_the_coefficients(sizes: list[int]) -> None:
    rng = np.random.default_rng(1)
    group = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    X = rng.normal(size=(len(group), 4))
    found = leave_groups_out(X, rng.normal(size=len(group)), group)
    for number in range(len(sizes)):
        own = X[group == number]
        rest = np.linalg.inv(X.T @ X - own.T @ own)
        spread = found.spread[group == number]
        np.testing.assert_allclose(spread @ spread.T, own @ rest @ own.T, rtol=1e-9, atol=1e-12)
        inside = np.trace(own @ np.linalg.inv(X.T @ X) @ own.T)
        assert found.growth[number] == pytest.approx(np.trace(own @ rest @ own.T) / inside)


def test_what_no_other_group_determines_is_said() -> None:
    X = np.eye(4)[[0, 0, 1, 1, 2, 2, 3, 3]]
    found = leave_groups_out(X, np.arange(8.0), np.array([0, 1, 0, 1, 0, 1, 2, 2]))
    assert found.determined.tolist() == [True, True, False]
    np.testing.assert_allclose(found.residual[6:], [-0.5, 0.5])
