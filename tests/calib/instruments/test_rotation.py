"""The rotation of least squares is the one that a search over all rotations finds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from calib.arrays import Array
from calib.instruments.placing import rotation


def asked(seed: int, rows: int, error: float) -> tuple[Array, Array, Array]:
    """Factor, target and the rotation that they are made of, but for errors."""
    rng = np.random.default_rng(seed)
    factor, R = rng.normal(size=(rows, 9)), Rotation.random(rng=rng).as_matrix()
    return factor, factor @ R.ravel() + error * rng.normal(size=rows), R


@pytest.mark.parametrize("rows", [5, 9])
def test_what_was_put_in_is_found(rows: int) -> None:
    factor, target, R = asked(rows, rows, 0.0)
    np.testing.assert_allclose(rotation(factor / 1e-6, target / 1e-6), R, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_fits_better_where_much_is_left(seed: int) -> None:
    factor, target, _ = asked(seed, 9, 2.0)

    def cost(r: Array) -> float:
        return float(np.sum((target - factor @ Rotation.from_rotvec(r).as_matrix().ravel()) ** 2))

    found = rotation(factor / 1e-6, target / 1e-6)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    starts = Rotation.random(30, rng=np.random.default_rng(1)).as_rotvec()
    least = min(minimize(cost, start, method="BFGS").fun for start in starts)
    assert np.sum((target - factor @ found.ravel()) ** 2) <= least * (1.0 + 1e-9)


def test_a_turn_that_nothing_tells_stays_a_rotation() -> None:
    found = rotation(np.zeros((3, 9)), np.zeros(3))
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
