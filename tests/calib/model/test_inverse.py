"""Covariances of directions that are not there, and budgets whose freedom has no bound."""

from __future__ import annotations

import numpy as np

from calib.model.covariance import clustered, covariance, ignorance
from calib.uncertainty.expanded import effective_freedom


def test_a_direction_that_moves_nothing_has_no_deviation() -> None:
    J = np.column_stack([np.random.default_rng(0).normal(size=(12, 2)), np.zeros(12)])
    found = covariance(J, np.eye(3))
    np.testing.assert_allclose(found[:2, :2], np.linalg.inv(J[:, :2].T @ J[:, :2]))
    assert not found[2].any()
    lost = np.array([False, False, True])
    assert np.isfinite(ignorance(J, np.eye(3), np.ones(3), lost)).all()
    rows = J.reshape(4, 3, 3)
    assert np.isfinite(clustered(rows[..., 0], rows, np.eye(3), np.zeros((0, 3)))).all()


def test_freedom_beyond_all_bounds_is_none() -> None:
    assert float(effective_freedom([(1.0, np.inf), (1e-20, 3.0)])) == np.inf
