"""Where capsules are, and what a scene says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import so3_exp, transform
from calib.cell.planned import Ball, Box, HalfSpace
from calib.errors import CalibError
from doe.constraints import constraints_of, scene_of, visible
from tests.doe.constraints.arms import planar, shaped
from tests.helpers import read_by


def test_names_of_capsules() -> None:
    names = [c.name for c in scene_of(shaped(1), np.zeros((2, 5))).capsules]
    assert names == ["base", "j1", "j3 #1", "j3 #2", "j4", "j5", "tool #1", "tool #2"]


def test_scene_of_another_robot() -> None:
    with pytest.raises(CalibError, match=r"shape \(2, 4\), expected \(n, 3\)"):
        scene_of(planar(), np.zeros((2, 4)))


def test_answers_do_not_depend_on_the_base_axes() -> None:
    """The whole cell turned and moved about: the same configurations, the same markers."""
    cell = shaped(3)
    R, p = so3_exp(np.array([0.4, -0.8, 1.1])), np.array([0.3, -0.2, 0.5])
    T = transform(R, p)
    box, ball, space = cell.design.obstacles
    assert isinstance(box, Box)
    assert isinstance(ball, Ball)
    assert isinstance(space, HalfSpace)
    obstacles = (
        replace(box, T_base_box=T @ box.T_base_box),
        replace(ball, centre=R @ ball.centre + p),
        replace(space, point=R @ space.point + p, normal=R @ space.normal),
    )
    origins = cell.robot.origins.copy()
    origins[0] = T @ origins[0]
    (post,) = cell.shapes.capsules["base"]
    post = Capsule(
        tuple(R @ np.array(post.start) + p), tuple(R @ np.array(post.end) + p), post.radius
    )
    assert cell.instrument is not None
    other = replace(
        cell,
        robot=replace(cell.robot, origins=origins),
        design=replace(cell.design, obstacles=obstacles),
        shapes=Shapes(dict(cell.shapes.capsules, base=(post,))),
        instruments=read_by(stands=R @ cell.instrument + p),
        gravity=R @ cell.gravity,
    )
    q = np.random.default_rng(6).uniform(-np.pi, np.pi, (400, 5))
    here, there = scene_of(cell, q), scene_of(other, q)
    for a, b in zip(constraints_of(cell), constraints_of(other), strict=True):
        np.testing.assert_array_equal(a.allows(here), b.allows(there), err_msg=a.name)
    np.testing.assert_array_equal(visible(here), visible(there))
