"""Scatter that was not found, averaged over: against dense algebra, and by what it must do."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arm.repeatability import Usual
from calib.arrays import Array
from calib.scatter import Scatter, Unnoticed, unnoticed
from calib.scatter.search import problem_of
from tests.calib.scatter.test_scatter import (
    SIGMA,
    drawn,
    linear_of,
    scattering,
    spread_over,
    visits_of,
)

AT_TIP = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
PLACES = 15
USUAL = Usual(best=5e-6, worst=4e-5)


def averaged(approaches: int, size: float, usual: Usual = USUAL, seed: int = 1) -> Unnoticed | None:
    """Of a day whose tip scatters by so much, m."""
    scatter, weighted, day = scattering(visits_of(PLACES, approaches, 1))
    r = drawn(day, 1.0, size**2 * AT_TIP, np.zeros(5), seed).reshape(weighted.shape[:2])
    problem, *_ = problem_of(scatter, weighted, linear_of(r, weighted[..., :3]))
    return unnoticed(scatter, problem, usual, 1.0)


def turning(scatter: Scatter) -> Array:
    """All joints alike, so that the tip scatters by one in a coordinate, by hand."""
    moved = (scatter.tip[:, :3, :3] ** 2).sum(axis=(1, 2)).mean() / 3.0
    return np.array([1.0, 1.0, 1.0, 0.0, 0.0]) / moved


@pytest.mark.parametrize("approaches", [1, 2])
def test_the_average_is_that_of_dense_matrices(approaches: int) -> None:
    """A fine sum over sizes, each weighed by a likelihood of plain inverses."""
    scatter, weighted, day = scattering(visits_of(PLACES, approaches, 1))
    y = drawn(day, 1.0, (8e-6) ** 2 * AT_TIP, np.zeros(5), 1)
    X = weighted[..., :3].reshape(len(y), 3)
    sizes = np.linspace(0.0, USUAL.worst, 60)
    values = []
    shapes = (AT_TIP, turning(scatter))
    for shape in shapes:
        for s in sizes:
            V = day.covariance(1.0, spread_over(s**2 * shape, 3), np.zeros(9))
            inverse = np.linalg.inv(V)
            N = X.T @ inverse @ X
            left = y - X @ np.linalg.solve(N, X.T @ inverse @ y)
            value = np.linalg.slogdet(V)[1] + np.linalg.slogdet(N)[1] + left @ inverse @ left
            values.append(value)
    weights = np.exp(-0.5 * (np.array(values) - min(values))).reshape(2, -1)
    weights /= 1.0 + (sizes / USUAL.best) ** 2
    weights /= weights.sum()
    added = (weights @ sizes**2) @ np.array(shapes)
    found = averaged(approaches, 8e-6)
    assert found is not None
    np.testing.assert_allclose(found.variances.approach, added, rtol=0.1)
    mean, square = (weights @ sizes**2).sum(), (weights @ sizes**4).sum()
    assert found.freedom == pytest.approx(max(1.0, 2.0 * mean**2 / (square - mean**2)), rel=0.1)


def test_more_scatter_adds_more_and_never_nothing() -> None:
    still, some, much = (averaged(1, size) for size in (0.0, 8e-6, 2e-5))
    assert still is not None
    assert some is not None
    assert much is not None
    tips = [float(one.variances.approach @ AT_TIP) for one in (still, some, much)]
    assert 0.0 < tips[0] < tips[1] < tips[2]
    assert still.freedom < much.freedom
    assert np.sqrt(tips[0]) < 0.5 * SIGMA


def test_arms_too_good_to_show_are_left_out() -> None:
    assert averaged(1, 0.0, Usual(best=1e-9, worst=1e-8)) is None
