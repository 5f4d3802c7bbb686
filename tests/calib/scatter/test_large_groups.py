"""Blocks of readings that err together, of any size, against plain dense matrices."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from calib.arrays import Array, by_size
from calib.poses import Poses, poses_at
from calib.scatter import Scatter, Variances
from calib.scatter.mixing import InverseFactor, Mixing
from calib.scatter.restricted import likelihood, mixed_model
from tests.calib.scatter.arms import Day, visits_of
from tests.calib.scatter.test_scatter import APPROACH, PLACE, scattering, spread_over

COLUMNS, KNOWN = 5, 3  # readings last


def uneven() -> Poses:
    """Four places: one left and read again three times, once for long, one read once, two twice."""
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (4, 3))
    return poses_at(q[[0, 0, 1, 2, 2, 2, 0, 3, 0, 0, 0, 0, 3, 3, 2]])


def dense(day: Day, scale: float, approach: Array, place: Array) -> Array:
    return day.covariance(scale, spread_over(approach, 3), spread_over(place, 3))


@pytest.mark.parametrize(
    ("approach", "place"), [(APPROACH, PLACE), (APPROACH, 0 * PLACE), (0 * APPROACH, PLACE)]
)
@pytest.mark.parametrize("markers", [1, 3])
def test_rows_are_mixed_by_the_inverse_cholesky_factor(
    approach: Array, place: Array, markers: int
) -> None:
    """Each row less what those before it tell, and nothing of those after."""
    scatter, weighted, day = scattering(uneven(), markers)
    mixing = scatter.at(Variances(1.7, approach, place)).mixing(weighted)
    V = dense(day, 1.7, approach, place)
    N, shape = len(V), weighted.shape[:2]
    unit = np.eye(N).reshape(*shape, N)
    expected = np.linalg.inv(np.linalg.cholesky(V))
    np.testing.assert_allclose(mixing(unit).reshape(N, N), expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(mixing.back(unit).reshape(N, N), expected.T, rtol=0.0, atol=1e-9)
    gains = np.random.default_rng(0).normal(size=(*shape, 4))
    flat = gains.reshape(N, 4)
    np.testing.assert_allclose(mixing.covariance(gains), flat.T @ V @ flat, rtol=1e-9)
    inverse = np.eye(N)
    for index, G in mixing.taken:
        for poses, own in zip(index, G, strict=True):
            rows = (poses[:, None] * shape[1] + np.arange(shape[1])).ravel()
            flat = own.reshape(len(rows), -1)
            inverse[np.ix_(rows, rows)] -= flat @ flat.T
    np.testing.assert_allclose(inverse / 1.7**2, np.linalg.inv(V), rtol=0.0, atol=1e-9)


def test_readings_of_many_rows_are_mixed_by_their_levers() -> None:
    """Each pose less what those before it tell, its own rows by a symmetric root."""
    scatter, weighted, day = scattering(uneven(), 20)
    mixing = scatter.at(Variances(1.7, APPROACH, PLACE)).mixing(weighted)
    V = dense(day, 1.7, APPROACH, PLACE)
    N, shape = len(V), weighted.shape[:2]
    unit = np.eye(N).reshape(*shape, N)
    W = mixing(unit).reshape(N, N)
    np.testing.assert_allclose(W @ V @ W.T, np.eye(N), rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(mixing.back(unit).reshape(N, N), W.T, rtol=0.0, atol=1e-9)
    rows = V.shape[0] // shape[0]
    assert not W[:rows, rows:].any()
    assert all(factor.L is not None for factor in _factors(mixing))


def _factors(mixing: Mixing) -> list[InverseFactor]:
    return [block.factor for level in mixing.levels for block in level.blocks]


@pytest.mark.parametrize("markers", [1, 2, 3])
@pytest.mark.parametrize("poses", [uneven(), visits_of(5, 1, 2), visits_of(5, 3, 1)])
def test_value_slope_and_information_are_those_of_dense_matrices(
    poses: Poses, markers: int
) -> None:
    """By their definitions: ``tr(P V_j) - y^T P V_j P y`` and ``tr(V^-1 V_i V^-1 V_j)``."""
    scatter, weighted, day = scattering(poses, markers)
    rng = np.random.default_rng(2)
    F = rng.normal(size=(*weighted.shape[:2], COLUMNS))
    problem = mixed_model(scatter, weighted, F, np.zeros((0, COLUMNS)), KNOWN, False)
    theta = rng.uniform(0.5, 2.0, len(problem.units))
    units = np.diag(problem.units)
    parts = [np.eye(len(day.H))]
    none = np.zeros(5)
    for unit in units[1:]:
        approach = unit[1:6] if len(unit) == 11 else none
        parts.append(dense(day, 0.0, approach, unit[-5:]))
    V = sum(t * part for t, part in zip(theta, parts, strict=True))
    X, E, y = np.split(F.reshape(-1, COLUMNS), [KNOWN, COLUMNS - 1], axis=1)
    inverse = np.linalg.inv(V)
    whole = np.column_stack([X, E])
    left = y - whole @ np.linalg.solve(whole.T @ inverse @ whole, whole.T @ inverse @ y)
    seen = X.T @ inverse @ X
    P = inverse - inverse @ X @ np.linalg.solve(seen, X.T @ inverse)
    pull = inverse @ left
    found = likelihood(problem, theta)
    value = np.linalg.slogdet(V)[1] + np.linalg.slogdet(seen)[1] + float((left.T @ pull)[0, 0])
    assert found.value == pytest.approx(value, rel=1e-9)
    slope = [np.trace(P @ part) - float((pull.T @ part @ pull)[0, 0]) for part in parts]
    np.testing.assert_allclose(found.gradient, slope, rtol=1e-9, atol=1e-9)
    information = [[np.trace(inverse @ a @ inverse @ b) for b in parts] for a in parts]
    np.testing.assert_allclose(found.information, information, rtol=1e-9, atol=1e-9)


def held(scatter: Scatter, weighted: Array) -> float:
    """MB that the likelihood and the mixing hold at most."""
    F = np.random.default_rng(0).normal(size=(*weighted.shape[:2], COLUMNS))
    tracemalloc.start()
    try:
        problem = mixed_model(scatter, weighted, F, np.zeros((0, COLUMNS)), KNOWN, False)
        likelihood(problem, np.ones(len(problem.units)))
        scatter.at(Variances(1.0, APPROACH, PLACE)).mixing(weighted)(F)
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("stays", [1, 2000])
def test_many_readings_of_one_place_hold_no_square(stays: int) -> None:
    """Two thousand readings in one stay, or each after a move: dense they are 36 million entries."""
    places = visits_of(2, stays, 2000 // stays)
    scatter, weighted, _ = scattering(places, 1)
    assert held(scatter, weighted) < 60.0


def test_groups_are_sorted_by_size() -> None:
    found = by_size(np.array([7, 3, 7, 5, 7, 5]))
    assert [own.tolist() for own in found] == [[[1]], [[3, 5]], [[0, 2, 4]]]
