"""Repeated readings: false alarms, and drift that was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.identification.drift import drift_p
from calib.model.build import build
from calib.poses import Measurements, Poses, poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from tests.helpers import all_seen, cell_of, random_robot

SIGMA = 1e-5
MARKERS = np.array([[0.28, -0.02, -0.09], [0.28, -0.03, 0.10], [0.28, 0.13, 0.01], [0.1, 0.0, 0.1]])


def day(visits: int, between: int = 2, hour: float = 600.0) -> Poses:
    """A reference at joints zero, with other poses between its readings, ten minutes a move."""
    q, names = [], []
    for v in range(visits):
        q.append(np.zeros(3))
        names.append(f"ref{v + 1}")
        for k in range(between if v < visits - 1 else 0):
            q.append(np.array([1.0 + v, 0.5 * k, -0.3]))
            names.append(f"p{v}{k}")
    poses = poses_at(np.array(q), names, time=hour * np.arange(len(q)))
    return with_moves(poses)


def readings(poses: Poses, points: Array, rng: np.random.Generator) -> Measurements:
    """Points (M, 3) read at every pose with noise."""
    noisy = points + rng.normal(size=(len(poses), *points.shape)) * SIGMA
    return all_seen(poses, noisy)


def p_of(data: Measurements) -> float:
    found = drift_p(data)
    assert found is not None
    return found


@pytest.mark.parametrize("markers", [1, 2, 4])
def test_no_drift_is_seldom_called_one(markers: int) -> None:
    rng = np.random.default_rng(markers)
    found = [p_of(readings(day(5, 1), MARKERS[:markers] + 2.0, rng)) for _ in range(300)]
    assert np.mean(np.array(found) < 0.05) < 0.08
    assert np.mean(np.array(found) < 0.01) < 0.03


def test_base_drift_is_found() -> None:
    """The effect base_drift of the simulation, seen in the frame of a turned and distant station."""
    rng = np.random.default_rng(5)
    cell = cell_of(random_robot(rng, 3), MARKERS[:3], ("base", "base_drift"), SIGMA)
    poses = day(6)
    model = build(cell, poses).model
    values = np.zeros(len(model.parameters))
    values[:6] = [1.0, -2.0, 0.5, 0.4, -0.3, 1.1]
    values[6:] = np.array([20e-6, -15e-6, 10e-6, 30e-6, 0.0, -10e-6]) / 3600.0
    days = [drawn_readings(model, values, poses, cell.noise, rng) for _ in range(60)]
    assert sum(p_of(data) < 0.01 for data in days) >= 58


def test_a_robot_that_does_not_return_does_not_drift() -> None:
    rng = np.random.default_rng(9)
    poses = day(8)
    alarms = 0
    for _ in range(100):
        data = readings(poses, MARKERS, rng)
        away = rng.normal(size=(len(poses), 1, 3)) * 4e-5
        alarms += p_of(replace(data, readings=data.points + away)) < 0.01
    assert alarms <= 5


def test_more_noise_than_stated_is_no_drift() -> None:
    rng = np.random.default_rng(13)
    data = [readings(day(8), MARKERS, rng) for _ in range(100)]
    louder = [replace(own, readings=MARKERS + 2.0 * (own.points - MARKERS)) for own in data]
    assert sum(p_of(own) < 0.01 for own in louder) <= 5


def test_only_what_was_left_and_read_again_counts() -> None:
    rng = np.random.default_rng(1)
    assert drift_p(readings(poses_at(np.zeros((4, 3))), MARKERS, rng)) is None
    twice = day(3, 1)
    data = readings(twice, MARKERS, rng)
    moved = replace(twice, station=np.arange(len(twice)), stations=tuple("abcde"))
    assert drift_p(replace(data, poses=moved)) is None


def test_time_gives_the_order() -> None:
    data = readings(day(4, 1), MARKERS, np.random.default_rng(1))
    turned = data.take(np.array([6, 1, 2, 3, 4, 5, 0]))
    assert p_of(turned) == pytest.approx(p_of(data))


@pytest.mark.parametrize("sides", [(1, -1, 1, -1), (1, 1, -1, 1), (1, -1, -1, 1)])
def test_backlash_is_no_drift(sides: tuple[int, ...]) -> None:
    """Free and loaded readings that jump together, by the side from which the arm came."""
    rng = np.random.default_rng(17)
    once = day(4, 1)
    approach = np.zeros((len(once), 3))
    approach[::2, 0] = sides
    poses = poses_at(
        np.repeat(once.q, 2, axis=0),
        time=60.0 * np.arange(2 * len(once)),
        wrench=np.tile([[0.0] * 6, [100.0] * 6], (len(once), 1)),
        approach=np.repeat(approach, 2, axis=0),
    )
    jump = poses.approach[:, :1, None] * [6e-5, 2e-5, 0.0]
    for _ in range(20):
        data = readings(poses, MARKERS, rng)
        assert p_of(replace(data, readings=data.points + jump)) > 0.01


def test_readings_equal_to_the_last_digit_are_no_drift() -> None:
    """As a display coarser than the noise shows them: nothing moved, and nothing to compare with."""
    data = readings(day(4), MARKERS, np.random.default_rng(3))
    still = replace(data, readings=np.broadcast_to(MARKERS, data.readings.shape).copy())
    assert p_of(still) == 1.0
