"""Scatter that was not found, averaged over: against dense algebra, and by what it must do."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arm.repeatability import Usual
from calib.arrays import Array
from calib.scatter import Scatter, Unnoticed, unnoticed
from calib.scatter.blocks import Block
from calib.scatter.nearby import NearbyLikelihood
from calib.scatter.restricted import MixedModel, maximised
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
    problem = problem_of(scatter, weighted, linear_of(r, weighted[..., :3]))
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


# -- What one step of scoring promises is what a search finds, where the variances change little ---


B, D = 200, 6  # configurations, rows of each


def problem(rng: np.random.Generator, size: float) -> MixedModel:
    """Configurations that scatter along one direction each, and a suspect that is there by so much."""
    Z = rng.normal(size=(B, D, 1))
    known, suspect = rng.normal(size=(2, B, D, 1))
    y = rng.normal(size=(B, D, 1)) + Z * 2.0 * rng.normal(size=(B, 1, 1)) + size * suspect
    F = np.concatenate([known, suspect, y], axis=-1)
    none, one = np.zeros((0, 3)), (B, 1, D)  # approaches of each
    own, F = Z.reshape(*one, 1), F.reshape(*one, 3)
    block = Block(own, own[..., :0], np.array([1]), np.zeros(0, dtype=int), F)
    return MixedModel((block,), none, none, 1, 0, 0, np.ones(2))


@pytest.mark.parametrize("size", [0.0, 0.2, 0.6])
def test_the_promise_is_nearly_the_gain_and_never_more(
    rng: np.random.Generator, size: float
) -> None:
    whole, free = problem(rng, size), np.array([0, 1])
    alone = whole.with_columns(np.array([0, 2]), 1)
    theta, before = maximised(alone, np.array([1.0, 1.0]), free, 1e-9)
    prior = np.array([[1e-3]])
    held = whole.with_columns(np.arange(3), 1, np.array([[0.0, 1e-3, 0.0]]))
    _, after = maximised(held, theta, free, 1e-9)
    gain = NearbyLikelihood(whole, theta, free).gain(np.array([1]), prior)
    exact = before.value - after.value
    assert gain.fall + gain.promised <= exact + 1e-6
    assert gain.fall + gain.promised == pytest.approx(exact, rel=0.05, abs=0.05)
    assert gain.fall < exact or size == 0.0
