"""Least squares, tails, scores, left-out groups and freedom against NumPy, SciPy and samples."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from calib.arrays import Array
from calib.change import COORDINATES
from calib.diagnosis.detection_limit import detectable, entry_limit
from calib.inference.coverage import freedom
from calib.inference.evidence import (
    f_tail,
    score_test,
    visible_directions,
    weighted_tail,
    weighted_test,
)
from calib.inference.least_squares import independent_columns, joined_triangle, solve, triangle
from calib.inference.leave_out import leave_groups_out
from calib.prediction.budget import Budget
from calib.sobol import Sobol

seeds = st.integers(0, 10**6)


@given(seeds, st.integers(1, 900), st.integers(1, 8))
@settings(max_examples=25, deadline=None)
def test_triangles_have_the_products_of_their_rows(seed: int, rows: int, columns: int) -> None:
    A = np.random.default_rng(seed).normal(size=(rows, columns))
    for R in (triangle(A), joined_triangle([A[: rows // 2], A[rows // 2 :]])):
        assert R.shape == (columns, columns)
        np.testing.assert_allclose(R, np.triu(R), atol=1e-12)
        np.testing.assert_allclose(R.T @ R, A.T @ A, rtol=1e-9, atol=1e-9)


def test_a_joined_triangle_keeps_digits_that_products_lose() -> None:
    A = np.random.default_rng(0).normal(size=(50, 3))
    A[:, 2] = A[:, 0] + 1e-10 * A[:, 2]
    R = joined_triangle([A[:20], A[20:]])
    assert abs(R[2, 2]) == pytest.approx(np.abs(triangle(A)[2, 2]), rel=1e-5)


@given(seeds, st.integers(0, 4))
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


# -- Tails


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
    rng, w = np.random.default_rng(0), np.array(weights)
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


# -- What columns would explain, and from which size on they are seen

N, X = np.split(np.random.default_rng(0).normal(size=(300, 13)), [8], axis=1)


def beside(columns: Array) -> Array:
    return np.asarray(columns - N @ np.linalg.lstsq(N, columns, rcond=None)[0])


def test_the_score_is_the_fall_of_the_sum_of_squares(rng: np.random.Generator) -> None:
    r, left = rng.normal(size=300), beside(X)
    fall, k = score_test(left.T @ left, left.T @ r, np.linalg.norm(X, axis=0))
    both, alone = np.column_stack([N, X]), beside(r)
    together = r - both @ np.linalg.lstsq(both, r, rcond=None)[0]
    assert fall == pytest.approx(alone @ alone - together @ together)
    assert k == 5
    inside = N @ rng.normal(size=(8, 2))  # what the model contains is invisible
    left, lengths = beside(inside), np.linalg.norm(inside, axis=0)
    assert score_test(left.T @ left, left.T @ r, lengths) == (0.0, 0)
    assert not visible_directions(left.T @ left, lengths)[1].any()
    assert np.isinf(detectable(left.T @ left, lengths, 10, 0.01).smallest).all()


@pytest.mark.parametrize("k", [1, 4])
def test_an_effect_of_the_size_said_to_be_detectable_is_detected(
    k: int, rng: np.random.Generator
) -> None:
    own, lengths = beside(X[:, :k]), np.linalg.norm(X[:, :k], axis=0)
    S = own.T @ own
    size = detectable(S, lengths, 200.0, 0.01).smallest[0]
    draws = rng.normal(size=(300, 300)) + own[:, :1] * size
    falls = np.array([float(score_test(S, own.T @ r, lengths)[0]) for r in draws.T])
    assert np.mean(falls > entry_limit(k, 200.0, 0.01)) == pytest.approx(0.9, abs=0.06)


@pytest.mark.parametrize("k", [1, 3, 6])
def test_a_score_at_the_entry_limit_pays_for_its_choice(k: int) -> None:
    """At the amplitude that is best where all directions show alike, by a fine grid of these."""
    limit, squared = entry_limit(k, 500.0, 1.0), np.geomspace(1e-3, 1e4, 4000)
    gains = squared * limit / (1.0 + squared) - k * np.log1p(squared)
    assert gains.max() == pytest.approx(2.0 * np.log(500.0), rel=1e-3)


@pytest.mark.parametrize("freedom", [np.inf, 290.0])
def test_a_weighted_test_comes_by_chance_as_often_as_it_says(
    freedom: float, rng: np.random.Generator
) -> None:
    left, lengths = beside(X[:, :3]), np.linalg.norm(X[:, :3], axis=0)
    S, spread = left.T @ left, np.diag([1.0, 0.1, 0.01])
    draws = left.T @ rng.normal(size=(300, 400))
    found = np.array([weighted_test(S, z, lengths, spread, freedom)[0] for z in draws.T])
    assert np.mean(found < 0.1) == pytest.approx(0.1, abs=0.045)


# -- Groups left out, freedom, and Sobol's points


@pytest.mark.parametrize("sizes", [[1, 2, 3, 4, 20], [5] * 8])
def test_left_out_errors_and_spreads_are_those_of_a_refit(sizes: list[int]) -> None:
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat(np.arange(len(sizes)) * 3, sizes))
    X, y = rng.normal(size=(len(group), 4)), rng.normal(size=len(group))
    found = leave_groups_out(X, y, group)
    assert found.determined.all()
    for number, name in enumerate(np.unique(group)):
        out = group == name
        values = solve(X[~out], y[~out]).values
        np.testing.assert_allclose(found.residual[out], y[out] - X[out] @ values, rtol=1e-9)
        rest, spread = np.linalg.inv(X[~out].T @ X[~out]), found.spread[out]
        expected = X[out] @ rest @ X[out].T
        np.testing.assert_allclose(spread @ spread.T, expected, rtol=1e-9, atol=1e-12)
        inside = np.trace(X[out] @ np.linalg.inv(X.T @ X) @ X[out].T)
        assert found.growth[number] == pytest.approx(np.trace(expected) / inside)


def test_what_no_other_group_determines_is_said() -> None:
    X = np.eye(4)[[0, 0, 1, 1, 2, 2, 3, 3]]
    found = leave_groups_out(X, np.arange(8.0), np.array([0, 1, 0, 1, 0, 1, 2, 2]))
    assert found.determined.tolist() == [True, True, False]
    np.testing.assert_allclose(found.residual[6:], [-0.5, 0.5])


def test_stays_count_where_poses_err_as_a_whole() -> None:
    """And two days are compared with more caution."""
    assert freedom(np.inf, 20, 30, as_a_whole=False) == np.inf
    assert freedom(50.0, 20, 30, as_a_whole=True) == pytest.approx(15.0)
    assert freedom(50.0, 4, 30, as_a_whole=True) == 1.0
    assert freedom(0.0, 4, 30, as_a_whole=False) == 1.0
    few = freedom(np.inf, 20, 30, as_a_whole=True, numbers=COORDINATES)
    assert few == pytest.approx(10.0)


def test_the_rule_covers_a_variance_of_whole_poses() -> None:
    """Stays of six numbers, variances that differ: an interval by the rule covers 95 % or more."""
    rng, stays, p, held, trials = np.random.default_rng(0), 15, 12, 0, 2000
    half = stats.t.ppf(0.975, freedom(np.inf, stays, p, as_a_whole=True))
    for _ in range(trials):
        J = rng.normal(size=(6 * stays, p))
        W = J / np.sqrt(np.tile(rng.chisquare(4, size=6) / 4.0, stays))[:, None]
        y = rng.normal(size=6 * stays)
        values, *_ = np.linalg.lstsq(W, y, rcond=None)
        r = y - W @ values
        std = np.sqrt(r @ r / (6 * stays - p) * np.linalg.inv(W.T @ W)[0, 0])
        held += abs(values[0]) <= half * std
    assert 0.95 <= held / trials <= 0.985


def test_sobols_points_are_those_of_scipy_and_beyond_its_dimensions_drawn_by_chance() -> None:
    for d in (1, 7, 48):
        ours, theirs = (kind(d, rng=np.random.default_rng(5)) for kind in (Sobol, qmc.Sobol))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # not a power of two
            for count in (16, 100, 300):
                np.testing.assert_array_equal(ours.random(count), theirs.random(count))
    points = Sobol(60, np.random.default_rng(1)).random(512)
    assert points.shape == (512, 60)
    assert len(np.unique(points[:, -1])) == 512
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.06)


def test_targets_count_by_their_weights() -> None:
    budget = Budget(np.array([1.0, 3.0, 0.0]), ())
    lengths = np.array([3.0, 1.0, 9.0])
    assert budget.worst(lengths) == 3.0
    assert budget.rms(lengths) == pytest.approx(np.sqrt(12.0 / 4.0))
