"""Many small matrices against numpy's of one, and minima that are none."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import Array
from calib.solver import condensed, inverse_factor, levenberg_marquardt


@pytest.mark.parametrize("wrong", [0.0, -1.0])
@pytest.mark.parametrize("count", [5, 80])
def test_one_matrix_that_is_not_positive_definite_is_refused(count: int, wrong: float) -> None:
    V = np.repeat(np.eye(4)[None], count, axis=0)
    V[3, 2, 2] = wrong
    with pytest.raises(np.linalg.LinAlgError):
        inverse_factor(V)


def test_a_covariance_singular_by_rounding_has_a_factor() -> None:
    """A level of noise beyond all others leaves the small ones below rounding."""
    H = np.random.default_rng(0).normal(size=(3, 20, 4))
    V = 1e17 * H @ np.swapaxes(H, -1, -2) + np.eye(20)
    for some in (V, V[:, :6, :6].repeat(30, axis=0)):
        assert np.isfinite(inverse_factor(some)).all()


def test_the_solver_does_not_call_a_dead_end_a_minimum() -> None:
    def wrong_way(v: Array) -> tuple[Array, Array]:
        return 1.0 - v, -np.eye(1)

    found = levenberg_marquardt(wrong_way, np.zeros(1), np.eye(1))
    assert not found.converged

    def nothing(v: Array) -> tuple[Array, Array]:
        return np.full(1, np.nan), np.eye(1)

    assert not levenberg_marquardt(nothing, np.zeros(1), np.eye(1)).converged


@pytest.mark.parametrize("shape", [(9, 12), (300, 12), (40_000, 12), (700, 130)])
def test_condensed_columns_have_the_same_products(shape: tuple[int, int]) -> None:
    """The last of them nearly the sum of the others, which squares would not show."""
    A = np.random.default_rng(1).normal(size=shape)
    A[:, -1] = A[:, :-1].sum(axis=1) + 1e-9 * A[:, -1]
    found = condensed(A)
    assert len(found) <= shape[1]
    np.testing.assert_allclose(found.T @ found, A.T @ A, rtol=1e-9, atol=1e-9 * shape[0])
    apart = np.append(-np.ones(shape[1] - 1), 1.0)
    np.testing.assert_allclose(np.linalg.norm(found @ apart), np.linalg.norm(A @ apart), rtol=1e-4)
