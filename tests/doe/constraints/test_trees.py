"""Plans of a robot with two arms: hands that meet, weights on both sides, joints without a drive."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

import doe
from calib import Tracker
from calib.arm.kinematics import forward, link_origins
from calib.arm.mimic import Coupling
from calib.arm.robot import Capsule, Shapes
from calib.arm.statics import loads_of, transmitted
from doe.constraints import scene_of
from doe.constraints.limits import static_torques
from doe.constraints.self_collision import clear_of_itself
from tests.calib.test_trees import two_hands

_RADIUS = 0.08


def test_balls_on_both_arms_keep_apart_in_all_pairs() -> None:
    """Balls at the joints' origins: their distances are all that counts."""
    cell, poses, _ = two_hands(2)
    robot = cell.robot
    ball = (Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), _RADIUS),)
    carriers = ("torso", "right2", "right4", "left2", "left4")
    own = replace(cell, shapes=Shapes(dict.fromkeys(carriers, ball)))
    constraint = clear_of_itself(own)
    assert constraint is not None
    assert not constraint.exempt
    o = forward(robot, poses.q).o[:, [robot.joints.index(name) + 1 for name in carriers]]
    free = np.ones(len(poses), dtype=bool)
    for a, b in combinations(range(len(carriers)), 2):
        free &= np.linalg.norm(o[:, a] - o[:, b], axis=1) > 2.0 * _RADIUS
    assert 0 < free.sum() < len(free)
    np.testing.assert_array_equal(constraint.allows(scene_of(own, poses.q)), free)


def test_links_that_hang_on_each_other_are_neighbours_on_every_branch() -> None:
    cell, _, _ = two_hands(2)
    ball = (Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1e-3),)
    shaped = ("torso", "right1", "left1")
    constraint = clear_of_itself(replace(cell, shapes=Shapes(dict.fromkeys(shaped, ball))))
    assert constraint is not None
    assert constraint.pairs == ((1, 2),)  # both arms with each other, neither with the torso


def test_drives_hold_what_hangs_on_both_sides() -> None:
    cell, poses, _ = two_hands(1)
    robot = cell.robot
    frames = forward(robot, poses.q)
    loads = loads_of(robot, poses, cell.payload, cell.gravity)
    local = transmitted(robot, loads, frames, link_origins(robot, frames, poses.q)).local
    expected = np.einsum("mki,ki->mk", local[:, 1 : robot.dof + 1, 3:], robot.axes)
    free, loaded = static_torques(scene_of(cell, poses.q))
    np.testing.assert_allclose(free, expected, atol=1e-10)
    np.testing.assert_allclose(loaded, expected, atol=1e-10)


def test_a_drive_holds_its_share_of_what_a_coupling_moves() -> None:
    cell, poses, _ = two_hands(1)
    free, _ = static_torques(scene_of(cell, poses.q))
    level = Coupling("right1", (("hip", -0.5), ("torso", -1.0)), 0.0)
    tied = replace(cell, robot=replace(cell.robot, couplings=(level,)))
    held, _ = static_torques(scene_of(tied, poses.q))
    hip, torso, right = (cell.robot.joints.index(name) for name in ("hip", "torso", "right1"))
    expected = free.copy()
    expected[:, hip] -= 0.5 * free[:, right]
    expected[:, torso] -= free[:, right]
    np.testing.assert_allclose(held, expected, atol=1e-10)


def test_a_plan_of_both_arms_keeps_an_undriven_joint_in_place_and_in_its_limits() -> None:
    cell, _, _ = two_hands(0)
    limits = np.tile([-2.0, 2.0], (10, 1))
    level = Coupling("right1", (("hip", -1.0), ("torso", -1.0)), 0.1)
    robot = replace(cell.robot, couplings=(level,), limits=limits)
    cell = replace(
        cell,
        robot=robot,
        instruments=(Tracker(sigma=2e-5),),
        effects=("base", "tool", "joint_offset"),
    )
    assert (np.abs(robot.sobol(50)) <= 2.0).all()
    q = doe.design(cell, poses=10, candidates=200).poses.q
    np.testing.assert_allclose(q[:, 2], 0.1 - q[:, 0] - q[:, 1], atol=1e-9)
    assert (np.abs(q) <= 2.0 + 1e-9).all()
