"""A lens that is not the cell's reads what OpenCV's projection with the true lens reads."""

from __future__ import annotations

import numpy as np
import pytest

from calib.effects.lens import Distortion, Focal, LensEffect, PrincipalPoint
from calib.instruments.lens import Lens
from calib.poses import poses_at
from tests.camera_cells import LENS

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
WRONG = {
    Focal: np.array([6.0, -4.0]),
    PrincipalPoint: np.array([3.5, -3.0]),
    Distortion: np.array([-0.03, 0.01, 4e-4, -3e-4, 2e-3]),
}


@pytest.mark.parametrize("kind", WRONG)
def test_pixels_are_those_of_the_true_lens(kind: type[LensEffect]) -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-0.4, 0.4, (50, 2)), np.ones((50, 1))], axis=1)
    nominal = Lens(LENS)
    by = np.zeros(9)
    by[kind.values] = WRONG[kind]
    fx, fy, cx, cy = (LENS + by)[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    true, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, (LENS + by)[4:])
    effect = kind("camera:cam", nominal)
    poses = poses_at(np.zeros((1, 6)))
    read, _, _ = effect.linearise(WRONG[kind], poses, nominal.project(points)[None])
    np.testing.assert_allclose(read[0], true[:, 0], atol=1e-6)
    same, _, _ = effect.linearise(0.0 * WRONG[kind], poses, nominal.project(points)[None])
    np.testing.assert_allclose(same[0], nominal.project(points), atol=1e-6)
