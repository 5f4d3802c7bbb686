"""Days: times by hand, ways round, poses that cannot be reached, and what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import Cell
from calib.arm.robot import Shapes
from calib.arrays import Array
from calib.cell import Load
from calib.cell.planned import Pace
from calib.poses import poses_at
from doe.constraints import constraints_of, scene_of
from doe.constraints.clearance import Clearance
from doe.day.day import day_of, quickest_order
from doe.day.duration import durations
from doe.day.straight import straight
from doe.day.ways import broken_at, times_between
from studies.day import day_entry, told
from tests.doe.constraints.arms import LINK, planar
from tests.helpers import designed

BALL = {"type": "sphere", "center_mm": (0, 1500, 0), "radius_mm": 300.0}


def paced(cell: Cell, speeds: float = 1.0, **pace: float) -> Cell:
    robot = replace(cell.robot, speeds=np.full(cell.robot.dof, speeds))
    return replace(cell, robot=robot, pace=Pace(**{"speed": 1.0} | pace))


def behind_a_ball() -> tuple[Cell, Array]:
    """Two links that reach two metres, a ball between their poses: they must fold to pass it."""
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
    assert day.moving == pytest.approx((1.0 + 0.5) + (2.0 + 0.5))
    assert day.standing == pytest.approx(3 * (3.0 + 2 * 7.0 + 2 * 120.0))
    assert day.least_moving == pytest.approx(day.moving)
    assert day.direct == 2
    assert not day.checked


def test_a_way_round() -> None:
    cell, q = behind_a_ball()
    day = day_of(cell, poses_at(q))
    (way,) = day.ways
    assert way.meets == "obstacle 1 (sphere)"
    assert way.free
    assert len(way.between)
    np.testing.assert_array_equal(way.points[[0, -1]], q)
    kept = [own for own in constraints_of(cell) if isinstance(own, Clearance)]
    share = np.linspace(0.0, 1.0, 2000)[:, None]
    for a, b in zip(way.points[:-1], way.points[1:], strict=True):
        assert straight(cell, kept, a[None], b[None]).free[0]
        scene = scene_of(cell, a + share * (b - a))
        assert all(own.allows(scene).all() for own in kept)
    # The second joint must fold by some 2.3 rad and back, with a halt between: 5.6 s.
    assert 5.0 < way.seconds < 6.5
    again = day_of(cell, poses_at(q)).ways[0]
    np.testing.assert_array_equal(again.points, way.points)
    assert not day_of(cell, poses_at(q), around=False).ways[0].free


def test_an_obstacle_around_the_base() -> None:
    """A pose that no way leads to is said, and comes where it costs least."""
    cell, q = behind_a_ball()
    wall = {"type": "box", "center_mm": (0, 1050, 0), "size_mm": (20, 1500, 400)}
    closed = designed(cell, obstacle=[wall, {**wall, "center_mm": (0, -1050, 0)}])
    day = day_of(closed, poses_at(q))
    assert day.blocked == (0,)
    said = [sentence.text for sentence in told(day_entry(day))]
    assert any("no way was found from p0000 to p0001" in text for text in said)
    assert np.isinf(times_between(closed, q)[0, 1])
    four = np.array([[0.3, 0.0], [np.pi - 0.3, 0.0], [0.4, 0.1], [np.pi - 0.4, 0.1]])
    order = quickest_order(closed, four)
    sides = (four[order, 0] > np.pi / 2).astype(int)
    assert np.abs(np.diff(sides)).sum() == 1


def test_the_order_keeps_to_straight_ways() -> None:
    """Folded poses between two others, over which the way leads that is not straight."""
    cell, q = behind_a_ball()
    folded = np.column_stack([q[:, 0], [-np.pi, -np.pi]])
    four = np.concatenate([q, folded])
    assert quickest_order(cell, four).tolist() in ([0, 2, 3, 1], [1, 3, 2, 0])
    assert day_of(cell, poses_at(four[[0, 2, 3, 1]])).direct == 3
    known = times_between(cell, four)[0, 1]
    assert durations(cell, q[1] - q[0]) < known
    assert known <= durations(cell, np.diff(four[[0, 2, 3, 1]], axis=0)).sum()


def test_a_pose_in_an_obstacle_is_named() -> None:
    cell, q = behind_a_ball()
    inside = np.array([[np.pi / 2, 0.0]])
    assert broken_at(cell, np.concatenate([q, inside])).tolist() == ["", "", "obstacle 1 (sphere)"]


def test_without_speeds_the_time_is_unknown() -> None:
    day = day_of(planar(2), poses_at(np.zeros((2, 2))))
    assert np.isnan(day.seconds)
    assert day.speedless == ("j1", "j2")
    (said,) = told(day_entry(day))
    assert said.text.startswith("unknown, as j1, j2 has no speed: give [robot.speed_deg_s]")
