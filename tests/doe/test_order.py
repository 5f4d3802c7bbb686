"""Orders against every permutation; times of a day by hand; poses that meet an obstacle."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from calib import Cell
from calib.arm.robot import Shapes
from calib.arrays import Array
from calib.cell import Load
from calib.cell.planned import Pace
from calib.poses import poses_at
from doe.constraints import broken_at
from doe.order import day_of, durations, quickest_order, shortest_order
from tests.doe.constraints.arms import LINK, planar
from tests.helpers import designed


def costs(n: int, seed: int) -> Array:
    """Of the joint that goes farthest between random poses."""
    x = np.random.default_rng(seed).uniform(size=(n, 6))
    return np.asarray(np.abs(x[:, None] - x).max(axis=-1))


def along(cost: Array, order: Array) -> float:
    return float(cost[order[:-1], order[1:]].sum())


@pytest.mark.parametrize("n", range(1, 9))
def test_against_every_order(n: int) -> None:
    every = np.array(list(itertools.permutations(range(n))))
    for seed in range(10):
        cost = costs(n, seed)
        best = cost[every[:, :-1], every[:, 1:]].sum(axis=1).min()
        order = shortest_order(cost)
        assert sorted(order) == list(range(n))
        assert along(cost, order) == pytest.approx(best)


@pytest.mark.parametrize("n", [15, 30, 60])
def test_it_is_much_shorter_than_the_given_order(n: int) -> None:
    for seed in range(5):
        cost = costs(n, seed)
        reached = along(cost, shortest_order(cost))
        assert reached < 0.8 * along(cost, np.arange(n))


BALL = {"type": "sphere", "center_mm": (0, 1500, 0), "radius_mm": 300.0}


def paced(cell: Cell, speeds: float = 1.0, **pace: float) -> Cell:
    robot = replace(cell.robot, speeds=np.full(cell.robot.dof, speeds))
    return replace(cell, robot=robot, pace=Pace(**{"speed": 1.0} | pace))


def behind_a_ball() -> tuple[Cell, Array]:
    """Two links that reach two metres, and a ball between their poses."""
    cell = designed(paced(planar(2)), obstacle=[BALL])
    cell = replace(cell, shapes=Shapes({"j1": (LINK,), "j2": (LINK,)}))
    return cell, np.array([[0.3, 0.0], [np.pi - 0.3, 0.0]])


def test_seconds_of_a_motion() -> None:
    """One joint reaches 2 rad/s in half a second over half a radian; another never gets there."""
    robot = replace(
        planar(2).robot, speeds=np.array([2.0, 2.0]), accelerations=np.array([np.nan, 1.0])
    )
    cell = replace(planar(2), robot=robot, pace=Pace(speed=1.0))
    assert durations(cell, np.array([3.0, 0.0])) == pytest.approx(3.0 / 2.0 + 0.5)
    assert durations(cell, np.array([0.0, -1.0])) == pytest.approx(2.0)
    assert durations(cell, np.array([3.0, 1.0])) == pytest.approx(2.0)
    slow = replace(cell, pace=Pace(speed=0.1))
    assert durations(slow, np.array([3.0, 0.0])) == pytest.approx(3.0 / 0.2 + 0.5)


def test_the_time_of_a_day() -> None:
    cell = replace(paced(planar(1), settle=3.0, reading=7.0), load=Load(10.0, (0, 0, 0)))
    day = day_of(cell, poses_at(np.array([[0.0], [1.0], [3.0]])))
    moving, standing = (1.0 + 0.5) + (2.0 + 0.5), 3 * (3.0 + 2 * 7.0 + 2 * 120.0)
    assert day == pytest.approx(moving + standing)


def test_the_order_takes_little_time() -> None:
    cell = paced(planar(1))
    assert quickest_order(cell, np.array([[0.0], [2.0], [1.0], [3.0]])).tolist() == [0, 2, 1, 3]


def test_a_pose_in_an_obstacle_is_named() -> None:
    cell, q = behind_a_ball()
    inside = np.array([[np.pi / 2, 0.0]])
    assert broken_at(cell, np.concatenate([q, inside])).tolist() == ["", "", "obstacle 1 (sphere)"]


def test_without_speeds_the_time_is_unknown() -> None:
    assert np.isnan(day_of(planar(2), poses_at(np.zeros((2, 2)))))
