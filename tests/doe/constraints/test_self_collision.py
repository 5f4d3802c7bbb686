"""The arm against itself and its base, against MuJoCo and by hand."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calib import Cell
from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import rpy_from_rotation, so3_exp, transform
from calib.cell.planned import Ball, Box, HalfSpace
from calib.errors import CalibError
from doe.constraints import constraints_of, scene_of, visible
from doe.constraints.scene import Scene
from doe.constraints.self_collision import SelfCollision
from tests.doe.constraints.arms import (
    LINKS,
    allowed,
    capsule_geoms,
    configurations,
    only,
    planar,
    shaped,
)
from tests.helpers import read_by


def test_collisions_are_those_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, model = arm
    geoms, capsules = capsule_geoms(scene, model), scene.capsules
    constraints = {c.name: c for c in constraints_of(cell)}
    crossing = constraints["self_collision"]
    assert isinstance(crossing, SelfCollision)
    bodies = [c.body for c in capsules]
    count = len(bodies)
    could = {(i, j) for i in range(count) for j in range(count) if bodies[j] - bodies[i] > 1}
    names = {(capsules[i].name, capsules[j].name): (i, j) for i, j in could}
    exempt = {names[pair] for pair in crossing.exempt}
    assert set(crossing.pairs) | exempt == could
    obstacles = {
        "obstacle 1 (box)": model.geom("box").id,
        "obstacle 2 (sphere)": model.geom("ball").id,
    }
    gaps: dict[str, list[float]] = {name: [] for name in (*obstacles, "self_collision")}
    for data in configurations(scene, model):

        def gap(a: int, b: int, data: mujoco.MjData = data) -> float:
            return mujoco.mj_geomDistance(model, data, a, b, 10.0, None)

        for name, geom in obstacles.items():
            gaps[name].append(min(gap(g, geom) for g, b in zip(geoms, bodies, strict=True) if b))
        pairs = crossing.pairs
        gaps["self_collision"].append(min(gap(geoms[i], geoms[j]) for i, j in pairs))
    for name, found in gaps.items():
        clear = np.abs(found) > 1e-5  # MuJoCo's own accuracy where a box is concerned
        allowed = constraints[name].allows(scene)
        np.testing.assert_array_equal(allowed[clear], np.array(found)[clear] > 0.0, err_msg=name)
        assert 0 < allowed.sum() < len(allowed)


def test_self_collision_spares_neighbours() -> None:
    cell = planar(shapes=Shapes(LINKS))
    crossing = only(cell)
    assert isinstance(crossing, SelfCollision)
    assert [crossing.pairs, crossing.exempt] == [((0, 2),), ()]
    # Links 1 and 2 on top of each other are neighbours; folded twice, links 1 and 3 meet.
    q = ((0, 0, 0), (0, 180, 0), (0, 170, 170), (0, 90, 150), (0, 90, 135), (0, 90, 90))
    assert allowed(cell, *q) == [True, False, False, False, True, True]


def test_pairs_that_always_overlap_are_exempt() -> None:
    """As at a spherical wrist: balls around one centre, with an arm each."""
    ball = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2)
    arm = Capsule((0.5, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
    crossing = only(
        planar(
            origins=np.tile(np.eye(4), (4, 1, 1)),
            shapes=Shapes({"j1": (arm, ball), "j3": (ball, arm)}),
        )
    )
    assert isinstance(crossing, SelfCollision)
    assert crossing.exempt == (("j1 #2", "j3 #1"),)
    assert crossing.pairs == ((0, 2), (0, 3), (1, 3))


# -- Where capsules are, and what a scene says of them ---------------------------------------------


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
        replace(box, centre=R @ box.centre + p, rpy=rpy_from_rotation(R @ box.T_base_box[:3, :3])),
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
