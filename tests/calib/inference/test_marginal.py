"""Coefficients of a block given all rows, against dense matrices."""

from __future__ import annotations

import numpy as np

from calib.inference import Marginal
from tests.calib.inference.designs import Dense, random_design, random_theta


def test_posterior_of_a_block_is_that_of_dense_matrices() -> None:
    design = random_design()
    theta = random_theta(design)
    found = Marginal.at(design, design.variances(theta))
    dense = Dense(design, theta)
    block = design.blocks[0]
    spread = theta[-1] * block.root @ block.root.T
    X = design.flat(block.columns)
    mean, covariance = found.posterior("free")
    expected = block.mean + spread @ X.T @ dense.P @ design.response
    np.testing.assert_allclose(mean, expected, rtol=1e-9)
    left = spread - spread @ X.T @ dense.P @ X @ spread
    np.testing.assert_allclose(covariance, left, rtol=1e-8, atol=1e-10)
