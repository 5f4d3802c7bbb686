"""Linear algebra of many small matrices, against numpy's of one."""

from __future__ import annotations

import numpy as np
import pytest

from calib.solver import inverse_factor


@pytest.mark.parametrize("shape", [(6,), (70, 1), (70, 6), (3, 40, 12), (70, 13)])
def test_inverse_factors_are_those_of_each_matrix(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(len(shape))
    half = rng.normal(size=(*shape, shape[-1])) * 10.0 ** rng.uniform(-3.0, 3.0, shape)[..., None]
    V = half @ np.swapaxes(half, -1, -2) + np.eye(shape[-1])
    found, d = inverse_factor(V), shape[-1]
    for L, own in zip(found.reshape(-1, d, d), V.reshape(-1, d, d), strict=True):
        exact = np.linalg.inv(np.linalg.cholesky(own))
        np.testing.assert_allclose(L, exact, rtol=1e-6, atol=1e-9 * np.abs(exact).max())


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
