"""Inverse roots of covariances with shared errors, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import Array, IntArray
from calib.inference.decorrelation import Groups, InverseRoot

M = 12
ALONE, PAIRS, PLACES = np.arange(M), np.arange(M) // 2, np.arange(M)[::-1] // 4
LEVELS: dict[str, tuple[tuple[IntArray, int], ...]] = {
    "none": (),
    "poses": ((ALONE, 3),),
    "groups": ((PLACES, 3),),
    "poses, then groups": ((ALONE, 3), (PLACES, 2)),
    "groups, then groups": ((PAIRS, 9), (PLACES, 2)),
}


def dense(levels: tuple[tuple[IntArray, int], ...], K: list[Array], scale: float) -> Array:
    """Covariance of all rows, entry by entry."""
    rows = K[0].shape[1] if K else 5
    V = np.eye(M * rows)
    for (group, _), levers in zip(levels, K, strict=True):
        flat, of_row = levers.reshape(M * rows, -1), np.repeat(group, rows)
        V += (flat @ flat.T) * (of_row[:, None] == of_row)
    return np.asarray(scale**2 * V)


@pytest.mark.parametrize("rows", [1, 5, 40])
@pytest.mark.parametrize("name", list(LEVELS))
def test_a_root_is_that_of_dense_matrices(name: str, rows: int) -> None:
    """The map, its transpose, the inverse in parts, and covariances."""
    rng, levels, scale = np.random.default_rng(rows), LEVELS[name], 1.7
    K = [rng.normal(size=(M, rows, k)) * 3.0 for _, k in levels]
    of = [(Groups.of(group), levers) for (group, _), levers in zip(levels, K, strict=True)]
    root, size = InverseRoot.of(scale, of), M * rows
    V, unit = dense(levels, K, scale) if K else scale**2 * np.eye(size), np.eye(size)
    W = root(unit.reshape(M, rows, size)).reshape(size, size)
    np.testing.assert_allclose(W @ V @ W.T, unit, atol=1e-9)
    np.testing.assert_allclose(root.back(unit.reshape(M, rows, size)).reshape(size, size), W.T)
    inverse = unit.copy()
    for groups, G in root.shared:
        flat, of_row = G.reshape(size, -1), np.repeat(groups.number, rows)
        inverse -= (flat @ flat.T) * (of_row[:, None] == of_row)
    np.testing.assert_allclose(inverse / scale**2, np.linalg.inv(V), atol=1e-9)
    gains = rng.normal(size=(M, rows, 3))
    flat = gains.reshape(size, 3)
    np.testing.assert_allclose(root.covariance(gains), flat.T @ V @ flat, rtol=1e-9)


def test_readings_of_one_pose_make_no_square() -> None:
    """Ten thousand of them in one group: as many numbers as levers and rows have."""
    rng = np.random.default_rng(0)
    K = rng.normal(size=(10_000, 3, 2))
    root = InverseRoot.of(1.0, [(Groups(np.zeros(10_000, dtype=int)), K)])
    y = rng.normal(size=(10_000, 3, 1))
    flat = K.reshape(-1, 2)
    whole = flat.T @ flat
    left = (root(y) ** 2).sum()
    along = flat.T @ y.ravel()
    expected = (y**2).sum() - along @ np.linalg.solve(np.eye(2) + whole, along)
    assert left == pytest.approx(expected)
