"""Sobol's points beside those of SciPy."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.stats import qmc

from calib.sobol import Sobol


@pytest.mark.parametrize("d", [1, 7, 48])
def test_points_are_those_of_scipy(d: int) -> None:
    ours, theirs = (kind(d, rng=np.random.default_rng(5)) for kind in (Sobol, qmc.Sobol))
    for count in (16, 100, 300):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # not a power of two
            np.testing.assert_array_equal(ours.random(count), theirs.random(count))


def test_dimensions_beyond_are_drawn_by_chance() -> None:
    points = Sobol(60, np.random.default_rng(1)).random(512)
    assert points.shape == (512, 60)
    assert len(np.unique(points[:, -1])) == 512
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.06)
