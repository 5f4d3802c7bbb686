"""Fisheye lenses: pixels are OpenCV's, derivatives those of differences, the way back leads back."""

from __future__ import annotations

import numpy as np
import pytest

from calib.effects.lens import Distortion
from calib.instruments.lens import Fisheye
from calib.poses import poses_at
from tests.helpers import central_difference

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
VALUES = np.array([520.0, 515.0, 641.0, 478.0, -0.02, 0.011, -0.006, 0.0012])
K = np.array([[VALUES[0], 0.0, VALUES[2]], [0.0, VALUES[1], VALUES[3]], [0.0, 0.0, 1.0]])
RNG = np.random.default_rng(4)
POINTS = np.column_stack([RNG.uniform(-1.5, 1.5, (60, 2)), RNG.uniform(0.3, 2.0, 60)])


def test_pixels_are_those_of_opencv() -> None:
    still = np.zeros(3)
    true, _ = cv2.fisheye.projectPoints(POINTS[:, None], still, still, K, VALUES[4:])
    np.testing.assert_allclose(Fisheye(VALUES).project(POINTS), true[:, 0], atol=1e-9)


@pytest.mark.parametrize("beside", [1.0, 1e-3, 1e-5, 1e-8, 0.0], ids=str)
def test_derivatives(beside: float) -> None:
    """Everywhere, on the axis and beside the camera too."""
    points = POINTS * [beside, beside, 1.0]
    pixels, by_points, by_lens = Fisheye(VALUES).linearise(points)
    np.testing.assert_allclose(pixels, Fisheye(VALUES).project(points), atol=1e-12)
    for k, (point, J) in enumerate(zip(points, by_points, strict=True)):
        numeric = central_difference(Fisheye(VALUES).project, point, np.full(3, 1e-6))
        np.testing.assert_allclose(J, numeric, atol=1e-4, err_msg=str(k))
    steps = np.array([1e-3] * 4 + [1e-6] * 4)
    numeric = central_difference(lambda v: Fisheye(v).project(points[None, None]), VALUES, steps)
    np.testing.assert_allclose(by_lens, numeric, atol=1e-5)


def test_what_is_behind_is_seen_by_a_wide_lens() -> None:
    around = np.array([[1.0, 0.0, 0.05], [1.0, 0.0, -0.05]])
    before, behind = Fisheye(VALUES).project(around)[:, 0]
    assert 0.0 < behind - before < 0.2 * VALUES[0]


def test_the_way_back() -> None:
    lens = Fisheye(VALUES)
    rays = POINTS[:, :2] / POINTS[:, 2:]
    np.testing.assert_allclose(lens.ideal(lens.project(POINTS)), rays, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(lens.ideal(VALUES[2:4]), [0.0, 0.0])


def test_many_lenses_at_once() -> None:
    by = RNG.normal(size=(3, 8)) * 1e-3
    together = Fisheye(VALUES).moved(by).linearise(POINTS[None])
    for i, own in enumerate(by):
        for a, b in zip(together, Fisheye(VALUES + own).linearise(POINTS), strict=True):
            np.testing.assert_allclose(np.broadcast_to(a, (3, *b.shape))[i], b, rtol=1e-12)


def test_an_error_of_its_distortion() -> None:
    off = np.array([0.01, -0.004, 0.002, -0.0005])
    effect = Distortion("camera:cam", Fisheye(VALUES))
    assert [p.name for p in effect.parameters] == ["k1", "k2", "k3", "k4"]
    narrow = POINTS[np.linalg.norm(POINTS[:, :2], axis=1) < 1.2 * POINTS[:, 2]]
    read = Fisheye(VALUES).project(narrow)
    wrong, _, _ = effect.linearise(off, poses_at(np.zeros((1, 6))), read[None])
    true, _ = cv2.fisheye.projectPoints(
        narrow[:, None], np.zeros(3), np.zeros(3), K, VALUES[4:] + off
    )
    np.testing.assert_allclose(wrong[0], true[:, 0], atol=1e-7)
