"""Poses of shapes from one image: exact ones, both of a plane, none of a line."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.instruments.resection import poses_of

cv2 = pytest.importorskip("cv2", exc_type=ImportError)

SQUARE = np.array([[0.0, 0, 0], [0.06, 0, 0], [0.06, 0.06, 0], [0, 0.06, 0]])
GRID = np.array([[x, y, 0.0] for y in range(5) for x in range(7)]) * 0.02
SOLID = np.random.default_rng(4).uniform(-0.05, 0.05, (9, 3))
TURNED = GRID @ so3_exp(np.array([0.4, -0.8, 0.3])).T + 0.2


def views(points: Array, count: int, seed: int) -> tuple[Array, Array, Array]:
    """Rotations, translations and OpenCV's rays of shapes that face the camera within 60 deg."""
    rng = np.random.default_rng(seed)
    R, t, rays = [], [], []
    while len(R) < count:
        own = so3_exp(rng.normal(size=3) * 2.0)
        if own[2, 2] < 0.5:
            continue
        at = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.4, 1.0)])
        found, _ = cv2.projectPoints(points, cv2.Rodrigues(own)[0], at, np.eye(3), np.zeros(5))
        R.append(own)
        t.append(at)
        rays.append(found[:, 0])
    return np.array(R), np.array(t), np.array(rays)


@pytest.mark.parametrize("points", [SQUARE, GRID, SOLID, SQUARE[[0, 2, 1, 3]], TURNED])
def test_exact_rays_give_the_pose_first(points: Array) -> None:
    for R, t, rays in zip(*views(points, 100, 1), strict=True):
        own, there, cost = poses_of(rays, points)[0]
        assert np.abs(own - R).max() < 1e-4
        assert np.abs(there - t).max() < 1e-4
        assert cost < 1.0


def test_a_plane_has_two_poses_and_a_solid_one() -> None:
    for points, count in ((SQUARE, 2), (SOLID, 1)):
        _, _, seen = views(points, 60, 2)
        seen = seen + np.random.default_rng(0).normal(scale=3e-4, size=seen.shape)
        assert [len(poses_of(rays, points)) for rays in seen].count(count) >= 54


def test_points_in_line_have_none() -> None:
    line = np.array([[0.02, 0, 0]]) * np.arange(5)[:, None]
    assert not poses_of(line[:, :2] + 0.1, line)
