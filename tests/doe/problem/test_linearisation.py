"""Rows in standard deviations, whatever an instrument reads."""

from __future__ import annotations

import numpy as np
import pytest

from doe.problem.linearisation import weighted


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_whitening_is_a_matrix_for_each_reading(rows: int) -> None:
    rng = np.random.default_rng(rows)
    W, columns = rng.normal(size=(4, 2, rows, rows)), rng.normal(size=(4, 2, rows, 5))
    found = weighted(W, columns)
    assert found.shape == (4, 2 * rows, 5)
    for m in range(4):
        for c in range(2):
            own = found[m, c * rows : (c + 1) * rows]
            np.testing.assert_allclose(own, W[m, c] @ columns[m, c], rtol=1e-12)


def test_one_number_weighs_all_coordinates_alike() -> None:
    rng = np.random.default_rng(0)
    W, columns = rng.normal(size=(4, 2, 1, 1)), rng.normal(size=(4, 2, 3, 5))
    whole = weighted(W * np.eye(3), columns)
    np.testing.assert_allclose(weighted(W, columns), whole, rtol=1e-12)
