"""Least squares against NumPy and tails against SciPy and sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from calib.inference.evidence import f_tail, weighted_tail
from calib.inference.least_squares import independent_columns, joined_triangle, solve, triangle


@given(st.integers(0, 10**6), st.integers(1, 900), st.integers(1, 8))
@settings(max_examples=25, deadline=None)
def test_triangles_have_the_products_of_their_rows(seed: int, rows: int, columns: int) -> None:
    A = np.random.default_rng(seed).normal(size=(rows, columns))
    for R in (triangle(A), joined_triangle([A[: rows // 2], A[rows // 2 :]])):
        assert R.shape == (columns, columns)
        np.testing.assert_allclose(R, np.triu(R), atol=1e-12)
        np.testing.assert_allclose(R.T @ R, A.T @ A, rtol=1e-9, atol=1e-9)


def test_a_joined_triangle_keeps_digits_that_products_lose() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(50, 3))
    A[:, 2] = A[:, 0] + 1e-10 * A[:, 2]
    R = joined_triangle([A[:20], A[20:]])
    assert abs(R[2, 2]) == pytest.approx(np.abs(triangle(A)[2, 2]), rel=1e-5)


@given(st.integers(0, 10**6), st.integers(0, 4))
@settings(max_examples=25, deadline=None)
def test_a_solution_is_that_of_numpy(seed: int, held: int) -> None:
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(20, 4)) * 10.0 ** rng.uniform(-6, 6, 4), rng.normal(size=20)
    prior, offset = X[:held] * 0.3, rng.normal(size=held)
    found = solve(X, y, prior, offset)
    A, b = np.concatenate([X, prior]), np.append(y, offset)
    size = np.linalg.norm(A, axis=0)
    np.testing.assert_allclose(found.values * size, np.linalg.lstsq(A / size, b, rcond=None)[0])
    own = np.linalg.inv((A / size).T @ (A / size))
    np.testing.assert_allclose(found.covariance * np.outer(size, size), own, rtol=1e-8)
    assert found.rank == 4


def test_dependent_columns_get_no_value() -> None:
    X = np.random.default_rng(0).normal(size=(10, 3))
    X = np.column_stack([X, X[:, 0] - 2.0 * X[:, 1], np.zeros(10)])
    found = solve(X, X[:, 0])
    assert found.rank == len(independent_columns(X)) == 3
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-12)
    assert found.values[4] == 0.0


@pytest.mark.parametrize("value", [1.0, 5.0, 40.0])
def test_equal_weights_are_a_chi_square_or_an_f(value: float) -> None:
    assert weighted_tail(np.full(4, 0.5), value) == pytest.approx(stats.chi2.sf(2.0 * value, 4))
    share = value / 60.0
    expected = stats.f.sf(share / (0.5 - share) * 56 / 4, 4, 56) if share < 0.5 else 0.0
    assert weighted_tail(np.full(4, 0.5), value, 60) == pytest.approx(expected)
    assert f_tail(value, 3, np.inf) == pytest.approx(stats.chi2.sf(3 * value, 3))


@pytest.mark.parametrize("freedom", [np.inf, 30.0])
@pytest.mark.parametrize("weights", [[1.0, 0.3], [1.0, 0.9, 0.5, 0.1, 0.01], [0.2] * 3 + [0.1] * 9])
def test_mixtures_are_those_of_samples(weights: list[float], freedom: float) -> None:
    rng = np.random.default_rng(0)
    w = np.array(weights)
    squares = rng.chisquare(1.0, (200_000, len(w)))
    sums = squares @ w
    if np.isfinite(freedom):
        rest = rng.chisquare(freedom - len(w), 200_000)
        sums = sums / ((squares.sum(axis=1) + rest) / freedom)
    for probability in (0.5, 0.1, 0.01):
        value = float(np.quantile(sums, 1.0 - probability))
        assert weighted_tail(w, value, freedom) == pytest.approx(probability, rel=0.1)


def test_tails_fall_from_one_to_nothing() -> None:
    w = np.array([1.0, 0.4, 0.05])
    found = [weighted_tail(w, x) for x in np.linspace(0.0, 60.0, 200)]
    assert found[0] == 1.0
    assert (np.diff(found) < 0.0).all()
    assert found[-1] < 1e-12
    assert weighted_tail(w, 50.0, 40.0) == 0.0
    assert weighted_tail(np.zeros(2), 0.0) == 1.0
