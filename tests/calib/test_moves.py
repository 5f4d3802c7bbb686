"""Approach and size of move from the order of measurement, over data and held-out poses together."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Diagnosis, Identification, Measurements, Poses
from calib.arrays import Array
from calib.errors import CalibError, EffectCannotAct
from calib.files.write_tables import measurements_csv
from calib.model.build import build
from calib.poses import poses_at
from calib.poses.moves import before_the_first_move, in_one_session, moves, visits, with_moves
from tests import plain_day as days
from tests.day import anywhere, read_of
from tests.helpers import all_seen, cell_of, random_robot, with_effects

Q = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.0], [0.2, 1.0], [0.2, 1.0], [0.2, 0.7]])
APPROACH = np.array([[0, 0], [1, 0], [1, 0], [-1, 1], [-1, 1], [-1, -1]])
MOTION = np.array([[0, 0], [0.5, 0], [0.5, 0], [0.3, 1], [0.3, 1], [0, 0.3]])


def as_data(poses: Poses) -> Measurements:
    """Of the poses with their moves."""
    return all_seen(with_moves(poses), np.zeros((len(poses), 1, 3)))


def same(a: Poses, b: Poses) -> None:
    for field in fields(Poses):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), field.name)


# -- Signs and sizes by hand


def test_a_joint_at_rest_keeps_its_side_and_repeats_keep_the_whole_move() -> None:
    """And the trembling of a servo is no move."""
    for q in (Q, Q + np.random.default_rng(0).uniform(-2e-6, 2e-6, Q.shape)):
        approach, motion = moves(q)
        np.testing.assert_array_equal(approach, APPROACH)
        np.testing.assert_allclose(motion, MOTION, atol=1e-15 if q is Q else 1e-5)
    given = with_moves(poses_at(Q, approach=np.ones_like(Q)))
    np.testing.assert_array_equal(given.approach, np.ones_like(Q))
    assert not given.approach_derived
    np.testing.assert_allclose(given.motion, MOTION, atol=1e-15)


def test_time_orders_the_poses_not_the_file() -> None:
    shuffled = np.array([3, 0, 5, 2, 1, 4])
    time = 100.0 + 10.0 * np.arange(len(Q))
    poses = with_moves(poses_at(Q[shuffled], time=time[shuffled]))
    np.testing.assert_array_equal(poses.approach, APPROACH[shuffled])
    np.testing.assert_allclose(poses.motion, MOTION[shuffled], atol=1e-15)
    assert poses.start == 100.0
    np.testing.assert_allclose(poses.elapsed, 10.0 * shuffled)
    in_file = with_moves(poses_at(Q[shuffled]))
    assert not np.array_equal(in_file.approach, poses.approach)
    # Without a clock their numbers tell the order in which they were reached.
    plain = with_moves(poses_at(Q))
    taken = visits(plain.take(shuffled))
    np.testing.assert_array_equal(taken, visits(plain)[shuffled])
    assert len(np.unique(taken)) < len(Q)


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


# -- Tables apart, and held out


def drawn(rng: np.random.Generator, timed: bool, in_days: bool) -> Poses:
    """Thirty poses anyhow: repeated joints, gaps of hours, days whose clock begins again."""
    q = rng.integers(-2, 3, (30, 3)) * 0.3
    time = np.cumsum(rng.choice([20.0, 60.0, 5000.0], 30, p=[0.5, 0.4, 0.1]))
    day = np.sort(rng.integers(0, 3, 30)) if in_days else np.zeros(30, dtype=int)
    time = time - (time[np.searchsorted(day, day)] if rng.random() < 0.5 else 0.0)
    shuffled = rng.permutation(30)
    names = np.array(["Mon", "Tue", "Wed"])[day[shuffled]] if in_days else None
    return poses_at(q[shuffled], time=time[shuffled] if timed else None, session=names)


@pytest.mark.parametrize("seed", range(8))
def test_no_table_held_out_changes_what_is_fitted(seed: int) -> None:
    rng, timed = np.random.default_rng(seed), bool(seed % 2)
    whole = drawn(rng, timed, bool(seed // 2 % 2))
    fitted = as_data(whole.take(np.arange(20)))
    for size in (1, 4, 10):
        own = 20 + rng.permutation(10)[:size]
        held = as_data(whole.take(own))
        data, out = in_one_session(fitted, held)
        same(data.poses, fitted.poses)
        if timed:
            told = with_moves(whole.take(np.append(np.arange(20), own))).take(slice(20, None))
            np.testing.assert_array_equal(out.poses.approach, told.approach)
            np.testing.assert_array_equal(out.poses.motion, told.motion)
            np.testing.assert_array_equal(out.poses.time, held.poses.time)
            assert out.poses.start == fitted.poses.start
        same(in_one_session(data, out)[1].poses, out.poses)
    # Parts of one table keep the moves of the whole.
    parts = as_data(whole).split(0.3, rng)
    for part, alone in zip(in_one_session(*parts), parts, strict=True):
        same(part.poses, alone.poses)


def test_a_share_is_held_out_after_the_moves_are_known(kr270: Cell, tmp_path: Path) -> None:
    rng, cell = np.random.default_rng(0), with_effects(kr270, "base", "tool")
    q, day = rng.uniform(*kr270.robot.limits.T, (12, 6)), np.array(["Mon 1", "Tue"])
    poses = poses_at(q, time=rng.permutation(12) * 60.0, session=day[rng.integers(0, 2, 12)])
    path = tmp_path / "measurements.csv"
    path.write_text(measurements_csv(cell, read_of(cell, poses, rng)))
    loaded, expected = calib.load_measurements(cell, path), with_moves(poses)
    np.testing.assert_array_equal(loaded.poses.approach, expected.approach)
    np.testing.assert_array_equal(loaded.poses.session, poses.session)
    for part in loaded.split(0.4, rng):
        i = [poses.names.index(name) for name in part.poses.names]
        np.testing.assert_array_equal(part.poses.approach, expected.approach[i])
        np.testing.assert_allclose(part.poses.elapsed, expected.elapsed[i])


# -- An arm with lost motion


def lossy(
    seed: int, count: int = 40, size: float = 1e-4, **given: Array
) -> tuple[Cell, Cell, Measurements, np.random.Generator]:
    """A cell that lacks lost motion, one that has it, and readings in their order."""
    rng = np.random.default_rng(seed)
    cell = cell_of(random_robot(rng, 4), rng.uniform(-0.2, 0.2, (3, 3)), ("base", "tool"))
    poses = with_moves(anywhere(cell, rng, count, **given))
    data = read_of(cell, poses, rng, "backlash:j3", noise=2e-5, backlash=size)
    return cell, with_effects(cell, "base", "tool", "backlash:j3"), data, rng


def in_turn(seed: int) -> tuple[Cell, Cell, Measurements, Measurements, np.random.Generator]:
    """The same of two tables that were read in turn, the second held out."""
    cell, full, whole, rng = lossy(seed, 60, 2e-4, time=60.0 * np.arange(60.0))
    own = np.isin(np.arange(60), rng.permutation(60)[:20])
    bare = replace(whole.poses, approach=None, motion=None, order=None, start=0.0)
    data, held = (
        replace(whole.take(part), poses=with_moves(poses_at(q=bare.q[part], time=bare.time[part])))
        for part in (~own, own)
    )
    return cell, full, data, held, rng


def keys(found: Diagnosis) -> list[str]:
    return [c.named.candidate.key for c in found.causes]


def test_backlash_from_the_order_alone_and_said_so() -> None:
    cell, full, data, _ = lossy(3)
    result = calib.identify(full, data)
    assert abs(result.values[-1] - 1e-4) < 4.0 * result.std[-1]
    assert any("derived from the order of the file" in text for text in result.warnings)
    plain = calib.identify(cell, data)
    assert not any("derived" in text for text in plain.warnings), "where nothing depends on it"
    silent = replace(data, poses=replace(data.poses, approach=None))
    with pytest.raises(CalibError, match=r"held-out poses have no approach, which backlash:j3"):
        calib.identify(full, data, heldout=silent)


@pytest.mark.parametrize(
    ("effect", "missing"),
    [
        ("backlash:j3", "nothing says from which side .* add columns approach_<joint>"),
        ("backlash", "backlash:j1 cannot act: nothing says"),
        ("base_drift", "base_drift:base cannot act: the poses have no time; add column time_s"),
        ("tracker_drift:instrument", "the poses have no time"),
        ("thermal_expansion:arm", "no temperature; add column temperature_degC"),
    ],
)
def test_poses_that_do_not_say_what_an_effect_needs(effect: str, missing: str) -> None:
    rng = np.random.default_rng(3)
    cell = cell_of(random_robot(rng, 4), np.zeros((1, 3)), ("base", effect))
    with pytest.raises(EffectCannotAct, match=missing):
        calib.predict(cell, np.zeros((5, 4)), {})


@cache
def without() -> tuple[Identification, Diagnosis]:
    """What the first table says alone."""
    cell, full, data, _, _ = in_turn(0)
    return calib.identify(full, data), calib.diagnose(cell, data)


@pytest.mark.sampled
@pytest.mark.parametrize("scrambled", [True, False])
def test_estimate_and_diagnosis_are_the_same_to_the_last_digit(scrambled: bool) -> None:
    cell, full, data, held, rng = in_turn(0)
    alone, found = without()
    mixed = replace(held, readings=rng.permuted(held.readings, axis=0))
    other = mixed if scrambled else held.take(slice(5))
    own, out = calib.in_one_session(data, other)
    beside = calib.identify(full, own, heldout=out)
    np.testing.assert_array_equal(beside.values, alone.values)
    np.testing.assert_array_equal(beside.covariance, alone.covariance)
    np.testing.assert_array_equal(beside.fit.vectors, alone.fit.vectors)
    again = calib.diagnose(cell, data, heldout=other)
    # What scrambled readings err by is no chance: it remains, and verdict and places say so.
    assert again.verdict == found.verdict or (scrambled and again.verdict == "unknown")
    assert again.located[: len(found.located)] == found.located
    assert scrambled or len(again.located) == len(found.located)
    assert (keys(again), again.refused) == (keys(found), found.refused)
    np.testing.assert_array_equal(again.after.values, found.after.values)
    np.testing.assert_array_equal(again.outlier, found.outlier)
    assert not scrambled or again.gap.heldout_rose is not None or not again.causes


def test_held_out_poses_that_speak_against_it_decide_nothing() -> None:
    cell, full, data, held, _ = in_turn(5)
    found = calib.diagnose(cell, data, heldout=held)
    assert found.gap.heldout_rose is False
    lost = build(full, held.poses).model
    values = np.append(found.before.values[: len(lost.parameters) - 1], -2e-4)
    _, out = in_one_session(data, held)
    opposite = replace(held, readings=lost.predict(values, out.poses))
    told = calib.diagnose(cell, data, heldout=opposite)
    assert told.gap.heldout_rose is True
    assert (keys(told), told.verdict) == (keys(found), found.verdict)


# -- What was read before the first move says nothing of lost motion, and must not mislead

HALF = np.array([2e-5, 1.8e-5, 2.5e-5, 1.5e-5, 3e-5])  # rad, of each joint
SOFT = 2e-7 * np.eye(5)[1]  # rad/(N m), of J2


def plan_day(folder: Path, sign: float, told: bool = False) -> tuple[Cell, Measurements]:
    """A plan, free and loaded, of which the first reading was reached by an unrecorded move.

    sign : whether the noise is turned round; told : with columns of the approach
    """
    rng = np.random.default_rng(3)
    q = np.repeat(days.joints(14, rng), 2, axis=0)
    came = np.sign(np.diff(q[::2], axis=0, prepend=q[:1] - [[1.0, -1.0, 1.0, -1.0, 1.0]]))
    came, force = np.repeat(came, 2, axis=0), np.tile([0.0, -600.0], 14)
    own = days.Errors(soft=SOFT, gap=HALF)
    points = days.points(own, q, force[:, None] * np.eye(6)[2], came, mass=0.0)
    noise = sign * np.random.default_rng(1).normal(size=points.shape) * 2e-5
    columns = {"fz_N": force}
    columns |= {f"approach_J{k}": one for k, one in enumerate(came.T, 1)} if told else {}
    effects = '"base", "tool", "joint_compliance:J2", "backlash"'
    path = days.write_cell(folder, effects, "", "")
    # What the readings say by themselves.
    text = path.read_text().replace("sigma_mm = 0.01\n", "sigma_mm = 0.02\n")
    path.write_text(text + 'size_prior = "off"\n')
    (folder / "measurements.csv").write_text(days.table(q, points + noise, columns))
    cell = calib.load_cell(path)
    return cell, calib.load_measurements(cell, folder / "measurements.csv")


def test_the_mean_of_days_is_the_truth(tmp_path: Path) -> None:
    """Of two days with opposite noise, which is that of many: the first reading would draw it away."""
    results = [calib.identify(*plan_day(tmp_path, sign)) for sign in (1.0, -1.0)]
    errors = []
    for result in results:
        assert not result.fit.outlier.any()
        assert result.waiting == ("p00", "p01")
        assert any("p00, p01 skipped: direction unknown" in w for w in result.warnings)
        ids = [p.id for p in result.model.parameters]
        names = [f"backlash:J{k}.half_width" for k in range(1, 6)]
        at = [ids.index(name) for name in ("joint_compliance:J2.compliance", *names)]
        errors.append((result.values[at] - [SOFT[1], *HALF]) / result.std[at])
    assert np.abs(errors[0] + errors[1]).max() / 2.0 < 0.02
    assert calib.identify(*plan_day(tmp_path, 1.0, told=True)).waiting == ()
