"""Approach and size of move from the order of measurement, over data and held-out poses together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.errors import CalibError, EffectCannotAct
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.noise import Noise
from calib.poses import Measurements, poses_at
from calib.poses.moves import before_the_first_move, in_one_session, moves, visits, with_moves
from calib.simulation import drawn_readings
from tests.helpers import all_seen, cell_of, random_robot, with_effects

Q = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.0], [0.2, 1.0], [0.2, 1.0], [0.2, 0.7]])
APPROACH = [[0, 0], [1, 0], [1, 0], [-1, 1], [-1, 1], [-1, -1]]
MOTION = [[0, 0], [0.5, 0], [0.5, 0], [0.3, 1], [0.3, 1], [0, 0.3]]


def test_signs_and_sizes_by_hand() -> None:
    """A joint at rest keeps the side from which it came; repeated readings keep the whole move."""
    approach, motion = moves(Q)
    np.testing.assert_array_equal(approach, APPROACH)
    np.testing.assert_allclose(motion, MOTION, atol=1e-15)


def test_the_trembling_of_a_servo_is_no_move() -> None:
    trembling = Q + np.random.default_rng(0).uniform(-2e-6, 2e-6, Q.shape)
    approach, motion = moves(trembling)
    np.testing.assert_array_equal(approach, APPROACH)
    np.testing.assert_allclose(motion, MOTION, atol=1e-5)


def test_time_orders_the_poses_not_the_file() -> None:
    shuffled = np.array([3, 0, 5, 2, 1, 4])
    time = 100.0 + 10.0 * np.arange(len(Q))
    poses = with_moves(poses_at(Q[shuffled], time=time[shuffled]))
    np.testing.assert_array_equal(poses.approach, np.array(APPROACH)[shuffled])
    np.testing.assert_allclose(poses.motion, np.array(MOTION)[shuffled], atol=1e-15)
    assert poses.start == 100.0
    np.testing.assert_allclose(poses.elapsed, 10.0 * shuffled)
    in_file = with_moves(poses_at(Q[shuffled]))
    assert not np.array_equal(in_file.approach, poses.approach)


def test_poses_taken_in_another_order_are_the_same_stays() -> None:
    """Without a clock their numbers tell the order in which they were reached."""
    poses, shuffled = with_moves(poses_at(Q)), np.random.default_rng(1).permutation(len(Q))
    taken = visits(poses.take(shuffled))
    np.testing.assert_array_equal(taken, visits(poses)[shuffled])
    assert len(np.unique(taken)) < len(Q)


def test_a_given_approach_is_kept() -> None:
    given = np.ones_like(Q)
    poses = with_moves(poses_at(Q, approach=given))
    np.testing.assert_array_equal(poses.approach, given)
    assert not poses.approach_derived
    np.testing.assert_allclose(poses.motion, MOTION, atol=1e-15)


def as_data(poses: Poses) -> Measurements:
    return all_seen(poses, np.zeros((len(poses), 1, 3)))


def test_moves_begin_anew_after_an_hour() -> None:
    time = np.array([0.0, 10.0, 20.0, 3620.5, 3630.0, 3640.0])
    poses = with_moves(poses_at(Q, time=time))
    np.testing.assert_array_equal(poses.approach, [*APPROACH[:3], [0, 0], [0, 0], [0, -1]])
    np.testing.assert_allclose(poses.motion, [*MOTION[:3], [0, 0], [0, 0], [0, 0.3]], atol=1e-15)
    np.testing.assert_array_equal(before_the_first_move(poses), [1, 0, 0, 1, 1, 0])
    assert len(set(visits(poses)[2:4])) == 2
    within = with_moves(poses_at(Q, time=time - 0.5 * (time > 3000.0)))
    np.testing.assert_array_equal(within.approach, APPROACH)


@pytest.mark.parametrize("seed", range(10))
def test_moves_do_not_reach_across_sessions(seed: int) -> None:
    """Each day has the moves that it has alone, wherever its rows stand and its clock begins."""
    rng = np.random.default_rng(seed)
    q, day = rng.integers(-2, 3, (20, 3)) * 0.3, np.array(["x", "y"])[rng.integers(0, 2, 20)]
    time = rng.permutation(20) * 60.0 if seed % 2 else None
    whole = with_moves(poses_at(q, time=time, session=day))
    waiting = before_the_first_move(whole)
    for name in ("x", "y"):
        own = day == name
        alone = with_moves(poses_at(q[own], time=None if time is None else time[own]))
        np.testing.assert_array_equal(whole.approach[own], alone.approach)
        np.testing.assert_array_equal(whole.motion[own], alone.motion)
        np.testing.assert_array_equal(waiting[own], before_the_first_move(alone))
        assert (np.diff(np.sort(whole.order[own])) == 1).all(), "a session is read in one go"


def test_without_times_tables_stay_in_their_own_order() -> None:
    first, second = as_data(with_moves(poses_at(Q))), as_data(with_moves(poses_at(Q[::-1])))
    for own, same in zip(in_one_session(first, second), (first, second), strict=True):
        np.testing.assert_array_equal(own.poses.approach, same.poses.approach)


def test_a_share_is_held_out_after_the_moves_are_known(kr270: Cell, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = with_effects(kr270, "base", "tool")
    q, day = rng.uniform(*kr270.robot.limits.T, (12, 6)), np.array(["Mon 1", "Tue"])
    poses = poses_at(q, time=rng.permutation(12) * 60.0, session=day[rng.integers(0, 2, 12)])
    model = build(cell, poses).model
    data = drawn_readings(model, np.zeros(len(model.parameters)), poses, cell.noise, rng)
    path = tmp_path / "measurements.csv"
    path.write_text(measurements_csv(cell, data))
    loaded = calib.load_measurements(cell, path)
    expected = with_moves(poses)
    np.testing.assert_array_equal(loaded.poses.approach, expected.approach)
    np.testing.assert_array_equal(loaded.poses.session, poses.session)
    for part in loaded.split(0.4, rng):
        i = [poses.names.index(name) for name in part.poses.names]
        np.testing.assert_array_equal(part.poses.approach, expected.approach[i])
        np.testing.assert_allclose(part.poses.elapsed, expected.elapsed[i])


def session(cell: Cell, rng: np.random.Generator, effect: str, size: float) -> Measurements:
    """Poses in the order in which they were measured, under one effect."""
    low, high = cell.robot.sample_limits().T
    poses = with_moves(poses_at(rng.uniform(low, high, (40, cell.robot.dof))))
    model = build(with_effects(cell, *cell.effects, effect), poses).model
    truth = np.zeros(len(model.parameters))
    truth[[p.effect == effect.partition(":")[0] for p in model.parameters]] = size
    return drawn_readings(model, truth, poses, Noise.isotropic(1e-5), rng)


def test_backlash_from_the_order_alone_and_said_so() -> None:
    rng = np.random.default_rng(3)
    cell = cell_of(random_robot(rng, 4), rng.uniform(-0.2, 0.2, (3, 3)), ("base", "tool"))
    data = session(cell, rng, "backlash:j3", 1e-4)
    result = calib.identify(with_effects(cell, "base", "tool", "backlash:j3"), data)
    assert abs(result.values[-1] - 1e-4) < 4.0 * result.std[-1]
    assert any("derived from the order of the file" in text for text in result.warnings)
    plain = calib.identify(cell, data)
    assert not any("derived" in text for text in plain.warnings), "where nothing depends on it"


def test_poses_that_do_not_say_what_an_effect_needs() -> None:
    rng = np.random.default_rng(3)
    cell = cell_of(random_robot(rng, 4), np.zeros((1, 3)), ("base",))
    q = np.zeros((5, 4))
    for effect, missing in (
        ("backlash:j3", "nothing says from which side .* add columns approach_<joint>"),
        ("backlash", "backlash:j1 cannot act: nothing says"),
        ("base_drift", "base_drift:base cannot act: the poses have no time; add column time_s"),
        ("tracker_drift:instrument", "the poses have no time"),
        ("thermal_expansion:arm", "no temperature; add column temperature_degC"),
    ):
        with pytest.raises(EffectCannotAct, match=missing):
            calib.predict(with_effects(cell, "base", effect), q, {})


def test_held_out_poses_must_say_it_too() -> None:
    rng = np.random.default_rng(3)
    cell = cell_of(random_robot(rng, 4), rng.uniform(-0.2, 0.2, (3, 3)), ("base", "tool"))
    data = session(cell, rng, "backlash:j3", 1e-4)
    silent = replace(data, poses=replace(data.poses, approach=None))
    with pytest.raises(CalibError, match=r"held-out poses have no approach, which backlash:j3"):
        calib.identify(with_effects(cell, "base", "backlash:j3"), data, heldout=silent)
