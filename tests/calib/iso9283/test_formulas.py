"""Every criterion of ISO 9283 against a sheet that is worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calib.iso9283.formulas import (
    accuracy_drift,
    angles,
    compliance,
    distances,
    largest_distance,
    of_scatter,
    position_accuracy,
    position_repeatability,
    repeatability_of,
)

POINTS = np.array([[13.0, 20, 30], [7.0, 20, 30], [10.0, 24, 30], [10.0, 16, 30]])


def test_pose_accuracy_and_repeatability() -> None:
    """Mean (10, 20, 30); 1, 2, 2 from the commanded point, so AP = 3. Distances from the mean 3, 3, 4,
    4: their mean 3.5, S = sqrt(4 x 0.25 / 3) = 0.5774, RP = 3.5 + 1.7321 = 5.2321.
    """
    found, off = position_accuracy(POINTS, np.array([9.0, 18.0, 28.0]))
    assert found.value == pytest.approx(3.0)
    np.testing.assert_allclose(off, [1.0, 2.0, 2.0])
    assert position_repeatability(POINTS).value == pytest.approx(3.5 + math.sqrt(3.0))


def test_angles() -> None:
    """1, 2, 3 mrad about x: mean 2, S = 1, RP = 3; nothing about y."""
    mean, scatter = angles(np.array([[1.0, 0.0, 5.0], [2.0, 0.0, 5.0], [3.0, 0.0, 8.0]]))
    np.testing.assert_allclose(mean, [2.0, 0.0, 6.0])
    np.testing.assert_allclose(scatter, [3.0, 0.0, 3.0 * math.sqrt(3.0)])


def test_distance_accuracy_and_repeatability() -> None:
    """Distances 5, 5, 8 of 5.5 commanded: mean 6, AD = 0.5; S = sqrt(3), RD = 3 sqrt(3)."""
    second = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 5.0], [8.0, 0.0, 0.0]])
    accuracy, again = distances(np.zeros((3, 3)), second, 5.5)
    assert accuracy.value == pytest.approx(0.5)
    assert again.value == pytest.approx(3.0 * math.sqrt(3.0))
    # Student's t of two degrees of freedom is 4.303.
    assert accuracy.high - accuracy.value == pytest.approx(4.303, abs=1e-3)


def test_ways_of_coming_and_drift() -> None:
    """Means at 0, (3, 4, 0) and (0, 0, 12): the last two are 13 apart, the last 12 from the first."""
    means = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 12.0]])
    assert largest_distance(means) == pytest.approx(13.0)
    assert accuracy_drift(means) == pytest.approx(12.0)


def test_static_compliance() -> None:
    """0, 100, 200 N move by 0.1, 0.3, 0.4 mm: the slope is (100 x 0.3) / (2 x 100^2) = 1.5 um/N; the
    residuals -1/60, 1/30, -1/60 mm have S^2 = 1/600 over one degree of freedom, t = 12.706.
    """
    found = compliance(np.array([0.0, 100.0, 200.0]), np.array([0.1, 0.3, 0.4]), 0.01)
    assert found.value == pytest.approx(1.5e-3)
    assert found.high - found.value == pytest.approx(
        12.706 * math.sqrt(1 / 600) / math.sqrt(2e4), rel=1e-4
    )
    # Two readings tell no scatter: by 0.01 mm each, 1.96 sqrt(2) 0.01 / 100.
    two = compliance(np.array([0.0, 100.0]), np.array([0.0, 0.2]), 0.01)
    assert two.high - two.value == pytest.approx(1.95996 * math.sqrt(2.0) * 1e-4, rel=1e-4)


def test_repeatability_of_a_known_scatter() -> None:
    """Alike in three directions distances are Maxwell's: mean 1.596, S 0.673, RP 3.616 sigma. Along one
    line they are half normal: 0.798 + 3 x 0.603 = 2.606.
    """
    assert repeatability_of(np.eye(3)) == pytest.approx(3.616, abs=1e-3)
    assert repeatability_of(np.diag([1.0, 0.0, 0.0])) == pytest.approx(2.606, abs=1e-3)
    rng = np.random.default_rng(0)
    cov = np.diag([4.0, 1.0, 0.25])
    away = np.linalg.norm(rng.standard_normal((400_000, 3)) @ np.sqrt(cov), axis=1)
    assert repeatability_of(cov) == pytest.approx(away.mean() + 3.0 * away.std(), rel=0.005)


@pytest.mark.parametrize("n", [5, 30])
@pytest.mark.parametrize("axes", [1, 3])
def test_intervals_hold_the_truth(n: int, axes: int) -> None:
    """Of 2000 tests of an arm that scatters along one axis or all, about 95 of 100 intervals hold what
    endless cycles would show; means are covered in every direction, and so more often.
    """
    rng, hits = np.random.default_rng(n), np.zeros(2)
    half = 0.05 * np.diag([1.0] * axes + [0.0] * (3 - axes))
    true = repeatability_of(half @ half)
    for _ in range(2000):
        points = [0.3, 0.0, 0.0] + rng.standard_normal((n, 3)) @ half
        found, _ = position_accuracy(points, np.zeros(3))
        again = position_repeatability(points)
        hits += [found.low <= 0.3 <= found.high, again.low <= true <= again.high]
    assert hits[0] / 2000 > 0.935
    assert 0.935 < hits[1] / 2000 < 0.985


def test_scatter_by_chi_square() -> None:
    """A standard deviation of ten degrees of freedom: from 0.699 to 1.755 of it, by tables."""
    found = of_scatter(1.0, 10.0)
    assert found.low == pytest.approx(0.699, abs=1e-3)
    assert found.high == pytest.approx(1.755, abs=1e-3)
