"""In a small set poses are tested one by one, and one that was left out wrongly comes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.identify.outliers import wrongly_out
from tests.doe.enough.day import cell_of_day, of_poses, whole_day

HALF = [2, 5, 8, 11, 14, 1]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_loaded_pose_that_only_bends_is_kept(kr270: Cell, table_two: Poses, seed: int) -> None:
    """The rigid part alone cannot follow the load, and leaves out a pose before the fit."""
    cell = cell_of_day(kr270)
    data = of_poses(whole_day(cell, table_two, seed), HALF, len(table_two))
    assert not calib.identify(cell, data).fit.outlier.any()


def test_a_wrong_point_is_found_all_the_same(kr270: Cell, table_two: Poses) -> None:
    cell = cell_of_day(kr270)
    data = of_poses(whole_day(cell, table_two), HALF, len(table_two))
    points = data.points.copy()
    points[8, 0] += [0.0, 0.4e-3, 0.0]
    found = calib.identify(cell, replace(data, points=points)).fit.outlier
    assert list(np.flatnonzero(found)) == [8]


def test_what_agrees_comes_back_and_what_says_nothing_does_not() -> None:
    statistics, rows = np.array([0.0, 1.2, 1.0, 50.0, *[1.0] * 10]), np.array([0, *[6] * 13])
    kept = np.ones(14, dtype=bool)
    assert wrongly_out(statistics, rows, kept, 60.0, 60) is None
    kept[0] = False  # its markers are hidden
    assert wrongly_out(statistics, rows, kept, 60.0, 60) is None
    kept[[1, 3]] = False
    assert wrongly_out(statistics, rows, kept, 60.0, 60) == 1
    kept[1] = True
    assert wrongly_out(statistics, rows, kept, 60.0, 60) is None
