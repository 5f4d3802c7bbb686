"""Poses of shapes from one image, against OpenCV's projection and its poses of planes."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.instruments.posit import posed, refined

cv2 = pytest.importorskip("cv2", exc_type=ImportError)

SQUARE = np.array([[0.0, 0, 0], [0.06, 0, 0], [0.06, 0.06, 0], [0, 0.06, 0]])
GRID = np.array([[x, y, 0.0] for y in range(5) for x in range(7)]) * 0.02
SOLID = np.random.default_rng(4).uniform(-0.05, 0.05, (9, 3))


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


@pytest.mark.parametrize("points", [SQUARE, GRID, SOLID, SQUARE[[0, 2, 1, 3]]])
def test_exact_rays_give_the_pose_first(points: Array) -> None:
    R, t, rays = views(points, 200, 1)
    first, at, sound = posed(rays, np.broadcast_to(points, (len(rays), *points.shape)))
    assert sound.all()
    seen = np.ones((len(rays), 1, len(points)), dtype=bool)
    found, there, cost = refined(rays[:, None], seen, points, first, at)
    best = np.arange(len(rays)), cost.argmin(axis=1)
    assert np.abs(found[best] - R).max() < 1e-6
    assert np.abs(there[best] - t).max() < 1e-7


def test_both_poses_of_a_tag_are_those_of_opencv() -> None:
    _, _, rays = views(SQUARE, 60, 2)
    rays = rays + np.random.default_rng(0).normal(scale=3e-4, size=rays.shape)
    first, at, _ = posed(rays, np.broadcast_to(SQUARE, (len(rays), 4, 3)))
    found, _, _ = refined(rays[:, None], np.ones((60, 1, 4), dtype=bool), SQUARE, first, at)
    near = 0
    for own, seen in zip(found, rays, strict=True):
        count, turns, *_ = cv2.solvePnPGeneric(
            SQUARE, seen, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
        )
        theirs = [cv2.Rodrigues(turn)[0] for turn in turns]
        apart = [min(np.abs(mine - other).max() for mine in own) for other in theirs]
        assert min(apart) < 0.2
        near += count == 2 and max(apart) < 0.2
    assert near >= 54  # where noise makes the second pose a minimum of its own


def test_points_in_line_are_not_sound() -> None:
    line = np.array([[0.02, 0, 0]]) * np.arange(5)[:, None]
    assert not posed(line[None, :, :2] + 0.1, line[None])[2].any()
