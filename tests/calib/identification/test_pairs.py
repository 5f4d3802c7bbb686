"""Which pairs of poses are compared: all of few, an even part of many, never more memory than that."""

from __future__ import annotations

import tracemalloc
from itertools import combinations

import numpy as np
import pytest

from calib.identification.residuals import _MOST, _pairs, pair_errors
from calib.poses import Measurements, poses_at


def test_of_few_poses_all_pairs_are_taken() -> None:
    rng = np.random.default_rng(0)
    poses = poses_at(np.zeros((9, 1)), station=np.array([0, 1, 0, 0, 1, 1, 0, 2, 0]))
    points, predicted = rng.normal(size=(2, 9, 2, 3))
    points[3, 1] = points[6, 1] + 0.01  # too near to say much
    seen = rng.uniform(size=(9, 2)) < 0.8
    seen[[3, 6], 1] = True
    data = Measurements(poses, points, seen, np.full((9, 2), np.nan))
    brute = [
        np.linalg.norm(points[a, j] - points[b, j])
        - np.linalg.norm(predicted[a, j] - predicted[b, j])
        for j in range(2)
        for a, b in combinations(range(9), 2)
        if poses.station[a] == poses.station[b]
        and seen[a, j]
        and seen[b, j]
        and np.linalg.norm(points[a, j] - points[b, j]) >= 0.05
    ]
    np.testing.assert_allclose(np.sort(pair_errors(data, predicted)), np.sort(brute), atol=1e-12)


@pytest.mark.parametrize("count", [2, 900, 20_000, 200_000])
def test_of_many_poses_an_even_part_is_taken_in_little_memory(count: int) -> None:
    station = np.arange(count) % 2 * (count > 2)
    tracemalloc.start()
    first, second = _pairs(station, _MOST)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e8
    total = sum(n * (n - 1) // 2 for n in np.bincount(station).tolist())
    assert len(first) == total if total <= _MOST else _MOST // 2 < len(first) <= _MOST
    assert (first < second).all()
    assert (station[first] == station[second]).all()
    assert len(np.unique(first * count + second)) == len(first)
    # Even: of a triangle of pairs the mean of the larger number is two thirds of the way.
    assert count == 2 or second.mean() / count == pytest.approx(2 / 3, abs=0.01)
