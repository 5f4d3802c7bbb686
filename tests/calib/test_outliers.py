"""Wrong poses are found; a posture that stands alone is none, and nothing runs away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import calib
from calib import Cell, Identification, Measurements, Poses
from calib.arrays import Array
from calib.identification import fit
from calib.identification.noise import replicate_factor
from calib.identification.outliers import changed_pose, judge, threshold
from calib.poses import poses_at
from calib.poses.moves import with_moves
from tests.calib.test_instruments import of_bodies, with_bodies
from tests.day import (
    ON_TOOL,
    PLAN_RIGID,
    RIGID,
    anywhere,
    cell_of_day,
    day,
    erring,
    of_poses,
    read_of,
    rigid_day,
    whole_day,
)
from tests.helpers import cell_of, random_robot, with_effects
from tests.plain_arm import frame, tips

NOISE = np.sqrt(3) * 1e-5  # m, 3-D RMS of readings


def rejected(found: Identification) -> list[int]:
    return np.flatnonzero(found.fit.outlier).tolist()


def shifted(data: Measurements, where: object, by: object) -> Measurements:
    """Points at poses, or at poses and markers, elsewhere by so much, m."""
    points = data.points.copy()
    points[where] += by  # type: ignore[index]
    return replace(data, readings=points)


# -- What is wrong is found, and bends nothing


def test_outliers_are_listed_and_do_not_bend_the_result(kr270: Cell) -> None:
    cell, data, _, _ = rigid_day(kr270.robot, 6, 60)
    data = shifted(shifted(data, 7, [0.0, 0.004, 0.0]), (23, 1), [0.001, 0.0, 0.0])
    data.readings[41] = data.readings[40]
    result = calib.identify(cell, data)
    assert rejected(result) == [7, 23, 41]
    assert result.noise.source == "cell"
    assert result.rms("fitted") < 2.0 * NOISE < result.rms("fitted_all")


@pytest.mark.parametrize("count", [15, pytest.param(120, marks=pytest.mark.long)])
def test_clean_data_have_no_outliers(kr270: Cell, count: int) -> None:
    cell, _, _, rng = rigid_day(kr270.robot, count, count)
    days = [erring(cell, anywhere(cell, rng, count), rng)[0] for _ in range(10)]
    assert sum(len(rejected(calib.identify(cell, data))) for data in days) <= 1


@pytest.mark.sampled
@pytest.mark.parametrize(("count", "size"), [(15, 2e-3), (15, 2.0), (28, 1e-1)])
def test_a_wrong_pose_among_few_is_found(kr270: Cell, count: int, size: float) -> None:
    rng, cell = np.random.default_rng(count), cell_of(kr270.robot, ON_TOOL, RIGID)
    for _ in range(2):
        data, _ = erring(cell, anywhere(cell, rng, count), rng)
        bad = int(rng.integers(count))
        result = calib.identify(cell, shifted(data, bad, rng.normal(size=3) * size))
        assert rejected(result) == [bad]
        assert result.rms("fitted") < 2.0 * NOISE


@pytest.mark.long
def test_gross_errors_do_not_bend_an_elastic_arm(kr270: Cell) -> None:
    """Three poses of thirty are metres off; compliances must not follow them."""
    rng = np.random.default_rng(0)
    cell = cell_of(kr270.robot, ON_TOOL, (*RIGID, "joint_compliance:A2,A3,A4,A5"))
    data, _ = erring(cell, anywhere(cell, rng, 30), rng, 0.3)
    bad = list(rng.choice(30, 3, replace=False))
    result = calib.identify(cell, shifted(data, bad, rng.normal(size=(3, 1, 3)) * 3.0))
    assert result.status == "converged"
    assert {*bad} <= {*rejected(result)}
    assert result.rms("fitted") < 3.0 * NOISE


def test_a_station_whose_only_pose_is_wrong(kr270: Cell) -> None:
    """Its base then hangs on that pose alone: the result says so and nothing fails."""
    rng, cell = np.random.default_rng(2), cell_of(kr270.robot, ON_TOOL, RIGID)
    given = {"station": np.r_[np.zeros(34, dtype=int), 1], "stations": ("north", "south")}
    data, _ = erring(cell, anywhere(cell, rng, 35, **given), rng)
    result = calib.identify(cell, shifted(data, (34, 0), 0.3))
    assert rejected(result) == [34]
    assert result.status == "rank_deficient"
    lost = {name for entry in result.unidentifiable for name in entry.names}
    assert lost == {f"base:south.{c}" for c in ("x", "y", "z", "rx", "ry", "rz")}
    assert result.rms("fitted") < 2.0 * NOISE


# -- A posture that stands alone is not set aside because it stands alone

ALONE = 7


def one_alone(seed: int, m: int, lacking: float = 0.0) -> tuple[Cell, Measurements]:
    """Poses of an arm, one of them alone in joint 3; couplings that the model lacks, rad/rad."""
    rng = np.random.default_rng(seed)
    cell = cell_of(random_robot(rng, 6), rng.uniform(-0.15, 0.15, (3, 3)), RIGID)
    q = rng.uniform(-1.4, 1.4, (m, 6))
    q[:, 2] = rng.uniform(-1.6, 0.1, m)
    q[ALONE, 2] = 1.6
    couplings = lacking * rng.normal(size=30)
    poses = with_moves(poses_at(q))
    data = read_of(cell, poses, rng, "joint_coupling", noise=2e-5, joint_coupling=couplings)
    return cell, data


@pytest.mark.parametrize("m", [24, pytest.param(40, marks=pytest.mark.long)])
def test_what_a_model_lacks_does_not_set_it_aside(m: int) -> None:
    """By a test that knows of no extrapolation 10 of 20 go where poses are few."""
    assert sum(ALONE in rejected(calib.identify(*one_alone(s, m, 1e-4))) for s in range(8)) <= 1


@pytest.mark.parametrize("at", [ALONE, 3])
@pytest.mark.parametrize("m", [24, pytest.param(40, marks=pytest.mark.long)])
def test_a_slip_is_found_there_and_elsewhere(m: int, at: int) -> None:
    for seed in range(4):
        cell, data = one_alone(seed, m)
        assert rejected(calib.identify(cell, shifted(data, (at, 1), [0.0, 6e-4, -8e-4]))) == [at]


# -- In a small set poses are tested one by one, and one that was left out wrongly comes back

HALF = [2, 5, 8, 11, 14, 1]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_loaded_pose_that_only_bends_is_kept(kr270: Cell, table_two: Poses, seed: int) -> None:
    """The rigid part alone cannot follow the load, and leaves out a pose before the fit."""
    cell = cell_of_day(kr270)
    data = of_poses(whole_day(cell, table_two, seed), HALF, len(table_two))
    assert rejected(calib.identify(cell, data)) == []
    if seed == 1:  # a wrong point is found all the same
        assert rejected(calib.identify(cell, shifted(data, (8, 0), [0.0, 0.4e-3, 0.0]))) == [8]


def test_a_judgement_that_does_not_settle_is_said(
    kr270: Cell, table_two: Poses, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two wrong points and one round: after it the second one still waits to be left out."""
    cell = with_effects(kr270, *PLAN_RIGID)
    plan = table_two.take(np.arange(24) % len(table_two))
    data = whole_day(cell, plan).take(slice(24))  # free of the load
    data = shifted(shifted(data, (3, 0), [0.0, 3e-3, 0.0]), (8, 1), [2e-3, 0.0, 0.0])
    settled = calib.identify(cell, data)
    assert rejected(settled) == [3, 8]
    assert (settled.undecided, settled.warnings) == ((), ())
    monkeypatch.setattr(fit, "_ROUNDS", 1)
    ended = calib.identify(cell, data)
    assert rejected(ended) == [3]
    assert ended.undecided == (data.poses.names[8],)
    assert f"whether to reject {data.poses.names[8]}:" in ended.warnings[0]
    # What it was judged by is of the fit without the first.
    assert ended.fit.statistic[8] > 10.0 * np.delete(ended.fit.statistic, [3, 8]).max()


def test_rows_that_were_copied_say_nothing_of_the_noise(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, *PLAN_RIGID)
    data = whole_day(cell, table_two).take(np.arange(24) % len(table_two))
    noise = calib.identify(cell, data).noise
    assert noise.replicate_factor is None
    assert 0.0 < noise.sigma < 5.0 * noise.believed


def test_what_agrees_comes_back_and_what_says_nothing_does_not() -> None:
    statistics, rows = np.array([0.0, 1.2, 1.0, 50.0, *[1.0] * 10]), np.array([0, *[6] * 13])
    kept = np.arange(14) != 3
    assert changed_pose(statistics, rows, kept, 60.0, 60) is None
    kept[0] = False  # its markers are hidden
    assert changed_pose(statistics, rows, kept, 60.0, 60) is None
    kept[1] = False
    assert changed_pose(statistics, rows, kept, 60.0, 60) == 1


@pytest.mark.parametrize("m", [16, 100])
def test_of_large_sets_little_beyond_chance_is_set_aside_and_at_most_an_eighth(m: int) -> None:
    """Quartiles of few poses are uncertain, and the limit leans to the longer tail."""
    squares = stats.chi2.ppf((np.arange(m) + 0.5) / m, 6) / 6
    limit = threshold(squares, 6)
    assert 1.2 < limit / (stats.chi2.isf(1e-3 / m, 6) / 6) < 1.7
    assert judge(squares, limit).sum() == 0
    assert judge(squares, squares[m // 2]).sum() == m * 12 // 100


def test_what_chance_brings_once_among_all_poses_stays() -> None:
    """One in a thousand of the fourteen is asked for, not one pose in a thousand."""
    statistics, rows, every = np.ones(14), np.full(14, 6), np.ones(14, dtype=bool)
    for chance, changed in ((1e-3, None), (1e-5, 5)):
        statistics[5] = stats.f.isf(chance, 6, 54)
        cost = 6.0 * statistics[5] + 54.0
        assert changed_pose(statistics, rows, every, cost, 60) == changed


def test_beside_residuals_of_nothing_a_wrong_pose_stands_out() -> None:
    """Where the rest fits exactly, what one pose adds is all, and no number overflows."""
    statistics, rows = np.array([1e10, 0.0, 0.0, 0.0, 0.0]), np.full(5, 3)
    every = np.ones(5, dtype=bool)
    assert changed_pose(statistics, rows, every, 3e10, 6) == 0
    assert changed_pose(0.0 * statistics, rows, every, 0.0, 6) is None
    assert changed_pose(statistics, rows, statistics == 0.0, 0.0, 6) is None


def test_a_gross_error_among_the_repeats_is_not_the_noise() -> None:
    cell, data, _, _ = day(seed=4, twice=12)
    weights = np.broadcast_to(np.eye(3) / cell.noise.across, (*data.seen.shape, 3, 3))
    assert replicate_factor(data, weights) == pytest.approx(1.0, abs=0.35)
    assert replicate_factor(data, 1.6 * weights) == pytest.approx(1.6, rel=0.3)
    wrong = shifted(data, 3, 50.0 * cell.noise.across)
    assert replicate_factor(wrong, weights) == pytest.approx(1.0, abs=0.35)


# -- What the data cannot tell stays where it was, and nothing runs away

BODY = np.array([0.05, -0.03, 0.2, 0.3, -0.2, 0.4])
STAND = np.array([1.5, -0.4, 0.3, 0.2, 0.5, -1.1])


def level(rng: np.random.Generator, count: int, turn: float) -> Array:
    """Joints at which the flange turns by ``turn`` rad at most: what A2 and A3 do, A5 undoes."""
    q = np.tile(np.radians([10.0, -60.0, 70.0, 0.0, 35.0, 20.0]), (count, 1))
    moved = rng.uniform(-0.3, 0.3, (count, 2))
    q[:, 1:3] += moved
    q[:, 4] -= moved.sum(axis=1)
    return q + turn * rng.uniform(-0.5, 0.5, q.shape)


def largest(found: Identification, *effects: str) -> float:
    """Of the values of these effects, m and rad."""
    own = [p.effect in effects for p in found.model.parameters]
    return float(np.abs(found.values[own]).max())


@pytest.mark.parametrize("turn", [0.0, 1e-3, 0.03])
def test_a_body_on_a_flange_that_hardly_turns(kr270: Cell, turn: float) -> None:
    rng = np.random.default_rng(0)
    q = level(rng, 40, turn)
    error = np.array([0.0, 1e-3, -1e-3, 0.0, 2e-3, 0.0])
    noise = rng.normal(size=(40, 6)) * np.repeat([2e-4, 5e-4], 3)
    seen = frame(STAND) @ tips(kr270.robot, q + error) @ frame(BODY) @ frame(noise)
    found = calib.identify(with_bodies(kr270.robot, RIGID), of_bodies(q, seen))
    assert largest(found, "tool", "base") < 10.0
    assert found.rms("nominal") < 0.02
    assert found.rms("fitted") < 5e-4
    if turn < 1e-2:
        assert found.status == "rank_deficient"


def test_a_marker_that_a_still_flange_does_not_tell_keeps_its_guess(kr270: Cell) -> None:
    rng = np.random.default_rng(1)
    cell = cell_of(kr270.robot, ON_TOOL[:1], ("base", "tool"))
    found = calib.identify(cell, erring(cell, poses_at(level(rng, 30, 0.0)), rng, 0.0)[0])
    assert found.unidentifiable
    assert largest(found, "tool") < 1e-6
    assert found.rms("fitted") < 1e-4


def test_stations_with_a_body_each_stay_in_the_room(kr270: Cell) -> None:
    """Neither station sees the other's bodies, and each few poses."""
    rng, station = np.random.default_rng(2), np.repeat([0, 1], 12)
    q = level(rng, 24, 1e-3)
    tip = tips(kr270.robot, q + 1e-3 * rng.normal(size=6))
    at = np.stack([frame(STAND), frame(-STAND)])[station]
    data = of_bodies(q, *(at @ tip @ frame(BODY + 0.1 * k) for k in range(4)))
    poses = replace(data.poses, station=station, stations=("north", "south"))
    seen = (np.arange(4)[None, :] // 2) == station[:, None]
    cell = with_bodies(kr270.robot, RIGID, bodies=4)
    assert largest(calib.identify(cell, replace(data, poses=poses, seen=seen)), "tool", "base") < 10


@pytest.mark.parametrize("moving", [[3], []], ids=["one joint", "none"])
def test_poses_that_tell_next_to_nothing(kr270: Cell, moving: list[int]) -> None:
    rng, cell = np.random.default_rng(3), cell_of(kr270.robot, ON_TOOL, RIGID)
    poses = anywhere(cell, rng, 30)
    still = np.tile(poses.q[:1], (30, 1))
    still[:, moving] = poses.q[:, moving]
    found = calib.identify(cell, erring(cell, replace(poses, q=still), rng)[0])
    assert found.status == "rank_deficient"
    assert largest(found, "tool", "base") < 30.0


def test_what_runs_away_is_told_and_stays(kr270: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that loses the first marker begins anew without it."""
    rng, cell = np.random.default_rng(4), cell_of(kr270.robot, ON_TOOL, ("base", "tool"))
    data, _ = erring(cell, anywhere(cell, rng, 30), rng)
    asked: list[int] = []

    def lost(model: calib.Model, data: Measurements, start: Array, values: Array) -> Array:
        asked.append(1)
        first = next(i for i, p in enumerate(model.parameters) if p.effect == "tool")
        return (np.arange(len(values)) == first) & (len(asked) == 1)

    monkeypatch.setattr(fit, "diverged", lost)
    (lost_one,) = calib.identify(cell, data).unidentifiable
    assert lost_one.names == ("tool:marker:m1.x",)
    assert "ran away" in lost_one.reason
