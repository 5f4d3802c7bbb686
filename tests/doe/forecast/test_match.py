"""Poses of a plan are found in the data by their joints, or by name where the joints are near."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import Cell, Measurements, Poses
from calib.cell import Repeatability
from calib.poses import poses_at
from doe.forecast.coming import match
from doe.forecast.coming import whole_day as coming_day
from tests.doe.forecast.day import cell_of_day, of_poses, whole_day


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return cell_of_day(kr270)


@pytest.fixture(scope="module")
def full(cell: Cell, table_two: Poses) -> Measurements:
    return whole_day(cell, table_two)


def renamed(poses: Poses) -> Poses:
    return replace(poses, names=tuple(f"x{i}" for i in range(len(poses))))


def test_poses_are_known_by_their_joints(cell: Cell, full: Measurements, table_two: Poses) -> None:
    data = renamed(of_poses(full, [3, 0, 7], 15).poses)
    shaken = np.random.default_rng(0).uniform(-1.0, 1.0, data.q.shape) * np.radians(1e-3)
    for poses in (data, replace(data, q=data.q + shaken)):
        done = match(cell, table_two, poses)
        assert (done.poses, done.warnings) == (3, ())
        assert set(range(30)) - set(done.left) == {0, 3, 7, 15, 18, 22}


def test_half_of_a_pose_is_half_done(cell: Cell, full: Measurements, table_two: Poses) -> None:
    """All free readings come before the first loaded one."""
    done = match(cell, table_two, full.poses.take(slice(0, 17)))
    assert done.poses == 2
    np.testing.assert_array_equal(done.left, np.arange(17, 30))


def test_names_count_where_the_joints_are_near(
    cell: Cell, full: Measurements, table_two: Poses
) -> None:
    poses = full.poses.take([4, 19])
    near = match(cell, table_two, replace(poses, q=poses.q + np.radians(2.0)))
    assert near.poses == 1
    assert "beside the plan's joints" in near.warnings[0]
    far = match(cell, table_two, replace(poses, q=poses.q + np.radians(20.0)))
    assert (far.poses, len(far.left)) == (0, 30)
    assert "is it the right plan" in far.warnings[0]


def test_a_reference_is_to_come_as_often_as_it_is_missing(cell: Cell, table_two: Poses) -> None:
    q = table_two.q[[0, 1, 2, 0, 3, 0]]
    plan = poses_at(q, ["ref1", "p1", "p2", "ref2", "p0", "ref3"])
    day = renamed(whole_day(cell, plan).poses.take([0, 1, 2, 3]))
    free = np.setdiff1d(np.arange(6), match(cell, plan, day).left)
    np.testing.assert_array_equal(free, [0, 1, 2, 3])
    # Read three times before the arm went on: one reading of the plan.
    thrice = renamed(day.take([0, 0, 0, 1]))
    free = np.setdiff1d(np.arange(6), match(cell, plan, thrice).left)
    np.testing.assert_array_equal(free, [0, 1])
    named = match(cell, plan, replace(thrice, names=("ref1", "ref2", "other", "p1")))
    np.testing.assert_array_equal(np.setdiff1d(np.arange(6), named.left), [0, 1, 3])


def test_what_is_left_is_known_by_its_pose_in_whatever_turn_it_is_read(
    cell: Cell, full: Measurements, table_two: Poses
) -> None:
    """An arm whose scatter is known reads each pose free and loaded in one stay."""
    left = match(cell, table_two, full.poses.take(slice(0, 17))).left
    for arm in (cell, replace(cell, repeatability=Repeatability(3e-5, 1e-4))):
        day, pose = coming_day(arm, full.take(np.arange(17)), table_two, left)
        assert len(day) == 30
        np.testing.assert_array_equal(pose[:17], -1)
        np.testing.assert_allclose(day.poses.q[17:], table_two.q[pose[17:]])
        # All free ones are read, and two loaded ones.
        assert sorted(pose[17:]) == list(range(2, 15))
        assert (day.poses.wrench[17:, 2] < -100.0).all()


def test_no_plan_leaves_nothing(cell: Cell, full: Measurements) -> None:
    assert len(match(cell, full.poses.take([]), full.poses).left) == 0
