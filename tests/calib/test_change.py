"""Changes of a robot between two days, against a truth composed by plain matrices.

The arm is a chain of joints about z behind origins of its own (:mod:`tests.plain_arm`): nothing that
makes the readings is known to the estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.change import (
    FALSE_ALARM,
    Changes,
    DayEstimate,
    Difference,
    changes,
    difference,
    errors_at,
    known_of,
    lasting,
    verdict,
)
from calib.effects import EFFECTS
from calib.errors import CalibError
from calib.poses import poses_at
from calib.prediction.estimate import estimate_of
from tests.helpers import all_seen, cell_of, light_chain
from tests.plain_arm import rpy_pose, shift, turn

ORIGINS = [
    [0.0, 0.0, 0.4, 0.0, 0.0, 0.1],
    [0.2, 0.05, 0.1, -1.5, 0.1, 0.0],
    [0.6, 0.0, 0.05, 0.2, -0.3, 0.2],
    [0.3, 0.1, 0.2, -1.4, 0.2, 0.1],
    [0.05, 0.1, 0.3, 1.5, 0.1, -0.2],
    [0.0, 0.05, 0.15, -1.3, 0.3, 0.0],
    [0.0, 0.0, 0.1, 0.0, 0.0, 0.0],
]
MARKERS = np.array([[0.1, 0.0, 0.02], [-0.05, 0.1, 0.0], [0.0, -0.08, 0.1]])
INSTRUMENT = shift(3.0, -1.0, 0.5) @ turn("z", 0.7) @ turn("x", 0.1)
ELSEWHERE = shift(-2.0, 2.5, 0.3) @ turn("z", -1.1)
SIGMA = 1e-5
POSES = 30


def arm() -> Cell:
    origins = np.array([rpy_pose([origin], np.zeros(0)) for origin in ORIGINS])
    robot = light_chain(origins, np.tile([-2.0, 2.0], (6, 1)))
    return cell_of(robot, MARKERS, ["base", "tool", "geometry"], SIGMA)


def measured(
    seed: int, instrument: Array = INSTRUMENT, offsets: Sequence[float] = (0,) * 6,
    lost_motion: float = 0.0, knock: Array | None = None, markers: Array = MARKERS,
) -> Measurements:  # fmt: skip
    """Readings of a day, m: T_instrument T_knock T_arm(q + errors) marker + noise."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.8, 1.8, (POSES, 6))
    approach = rng.choice([-1.0, 1.0], q.shape)
    true = q + np.array(offsets)
    true[:, 2] += lost_motion * approach[:, 2]
    frames = [
        instrument @ (np.eye(4) if knock is None else knock) @ rpy_pose(ORIGINS, row)
        for row in true
    ]
    points = np.array([markers @ T[:3, :3].T + T[:3, 3] for T in frames])
    noisy = points + SIGMA * rng.standard_normal(points.shape)
    return all_seen(poses_at(q, approach=approach), noisy)


@pytest.fixture(scope="module")
def cell() -> Cell:
    return arm()


@pytest.fixture(scope="module")
def before(cell: Cell) -> DayEstimate:
    return known_of(calib.identify(cell, measured(1)))


def compared(cell: Cell, before: DayEstimate, data: Measurements) -> Changes:
    found = calib.identify(cell, data)
    return changes(cell, before, known_of(found), estimate_of(found))


def moved_in(found: Changes) -> list[tuple[str, str, str]]:
    both = zip(found.difference.keys, found.difference.moved, strict=True)
    return [key for key, moved in both if moved]


def test_a_robot_that_stayed_raises_no_alarm(cell: Cell, before: DayEstimate) -> None:
    for seed, instrument in ((2, INSTRUMENT), (3, ELSEWHERE)):
        found = compared(cell, before, measured(seed, instrument))
        assert found.difference.p_value > FALSE_ALARM
        assert verdict(found.kept[1], 1e-4) == "holds"
        assert not found.difference.moved.any()
        assert found.there.low == 0.0
    assert found.difference.apart == ("base:base",)
    assert all(key[0] != "base" for key in found.difference.keys)


def test_a_slipped_belt_is_seen_and_sized(cell: Cell, before: DayEstimate) -> None:
    slip = 1.5e-4
    for instrument in (INSTRUMENT, ELSEWHERE):
        found = compared(cell, before, measured(4, instrument, (0, 0, slip, 0, 0, 0)))
        assert found.difference.p_value < FALSE_ALARM
        assert found.difference.moved.any()
        assert verdict(found.kept[1], 5e-6) == "does_not"
        # What the slip does at the targets, by plain matrices about the true arm. Where the instrument
        # stands elsewhere, the base is placed anew and takes up a part.
        moved_by = []
        for q in targets_of(cell)[0].q:
            then, now = (rpy_pose(ORIGINS, q + s * np.eye(6)[2]) for s in (0.0, slip))
            points = [MARKERS @ T[:3, :3].T + T[:3, 3] for T in (then, now)]
            moved_by.append(((points[1] - points[0]) ** 2).sum(axis=1).mean())
        true = float(np.sqrt(np.mean(moved_by)))
        if instrument is INSTRUMENT:
            assert found.there.low < true < found.there.high
            assert found.there.value == pytest.approx(true, rel=0.15)
        else:
            assert found.there.value < true


def test_a_knock_of_the_base_is_one_of_the_instrument(cell: Cell, before: DayEstimate) -> None:
    knock = shift(1e-4, -5e-5, 2e-4) @ turn("x", 1e-4) @ turn("y", -2e-4)
    found = compared(cell, before, measured(5, knock=knock))
    assert {effect for effect, _, _ in moved_in(found)} == {"base"}
    # Of the knock nothing is left where the instrument was put elsewhere: nobody can tell.
    hidden = compared(cell, before, measured(5, ELSEWHERE, knock=knock))
    assert hidden.difference.p_value > FALSE_ALARM


def test_markers_and_tools(cell: Cell, before: DayEstimate) -> None:
    bent = MARKERS + np.array([[0, 0, 0], [1e-4, 5e-5, 0], [0, 0, 0]])
    found = compared(cell, before, measured(7, markers=bent))
    assert {where for _, where, _ in moved_in(found)} == {"marker:m2"}
    apart = compared(cell, before, measured(9, markers=MARKERS + np.array([0.05, 0.0, 0.0])))
    assert set(apart.difference.apart) == {f"tool:marker:m{j}" for j in (1, 2, 3)}
    assert apart.difference.p_value > FALSE_ALARM


def test_what_one_day_left_open_is_no_change(cell: Cell) -> None:
    """With joint 4 held still, its neighbours take up what it cannot show; both days know the rest."""
    truth = (0, 0, 0, 3e-4, 0, 0)
    still = measured(12, offsets=truth)
    still.poses.q[:, 3] = 0.4
    T = [INSTRUMENT @ rpy_pose(ORIGINS, row) for row in still.poses.q + np.array(truth)]
    points = np.array([MARKERS @ t[:3, :3].T + t[:3, 3] for t in T])
    points += SIGMA * np.random.default_rng(0).standard_normal(points.shape)
    poor = known_of(calib.identify(cell, replace(still, readings=points)))
    assert poor.lost.any()
    found = compared(cell, poor, measured(13, offsets=truth))
    assert len(found.difference.whitened) < len(found.difference.keys)
    assert found.difference.p_value > FALSE_ALARM
    assert not found.difference.moved.any()
    assert np.isnan(found.difference.std).any()


def drawn(rng: np.random.Generator, cov: Array, shift_: Array | float = 0.0) -> DayEstimate:
    """An estimate of joint offsets that is known to be normal."""
    k = len(cov)
    keys = tuple(("joint_offset", f"j{i}", "offset") for i in range(k))
    values = rng.multivariate_normal(np.zeros(k), cov) + shift_
    return DayEstimate(keys, values, cov, np.zeros(k, dtype=bool), {}, np.inf)


def test_false_alarms_are_held_over_all_parameters() -> None:
    rng = np.random.default_rng(3)
    k, trials = 25, 800
    A, B = rng.normal(size=(2, k, k))
    covs = [1e-10 * (M @ M.T + 0.1 * np.eye(k)) for M in (A, B)]
    found = [difference(drawn(rng, covs[0]), drawn(rng, covs[1])) for _ in range(trials)]
    alarms = np.mean([one.p_value < FALSE_ALARM for one in found])
    assert 0.008 < alarms < 0.034
    assert np.mean([one.moved.any() for one in found]) <= alarms
    # A known shift of noncentrality 60 is seen.
    total = covs[0] + covs[1]
    e = np.eye(k)[0]
    shift_ = e * np.sqrt(60.0 / (e @ np.linalg.solve(total, e)))
    seen = [
        difference(drawn(rng, covs[0]), drawn(rng, covs[1], shift_)).p_value for _ in range(100)
    ]
    assert np.mean(np.array(seen) < FALSE_ALARM) > 0.95


def test_a_difference_small_by_luck_still_may_hide_something() -> None:
    """By the inversion alone the upper end would be zero."""
    rows, weights, cov = np.ones((5, 3, 4)), np.ones(5), np.eye(4)
    found, _ = errors_at(rows, np.full(4, 1e-6), cov, weights)
    usual, _ = errors_at(rows, np.full(4, 1.0), cov, weights)
    assert found.value == found.low == 0.0
    assert 0.5 * usual.high < found.high < usual.high


def test_results_of_two_models_are_refused() -> None:
    one = drawn(np.random.default_rng(4), np.eye(3))
    keys = (("backlash", "j1", "half_width"), *one.keys[1:])
    with pytest.raises(
        CalibError, match=r"one result lacks backlash:j1.half_width, joint_offset:j0"
    ):
        difference(one, replace(one, keys=keys))
    none = replace(one, keys=tuple(("base", "base", name) for name in "xyz"))
    with pytest.raises(CalibError, match="no parameter of the robot in common"):
        difference(none, none)


def test_intervals_hold_the_truth() -> None:
    rng = np.random.default_rng(5)
    k, trials = 8, 600
    M = rng.normal(size=(k, k))
    cov = M @ M.T
    rows, weights = rng.normal(size=(12, 3, k)), rng.uniform(0.5, 2.0, 12)
    root = np.linalg.cholesky(cov)
    for size in (0.0, 0.5, 2.0, 10.0):
        delta = size * rng.normal(size=k)
        true = np.sqrt((weights @ ((rows @ delta) ** 2).sum(axis=1)) / weights.sum())
        inside = []
        for _ in range(trials // 4):
            rms, worst = errors_at(rows, delta + root @ rng.standard_normal(k), cov, weights)
            inside.append(rms.low <= true + 1e-12 and true <= rms.high)
            assert worst.high >= rms.value
        assert np.mean(inside) > 0.89
    assert verdict(rms, rms.high) == "holds"
    assert verdict(rms, 0.999 * rms.high) == "cannot_be_said"
    assert verdict(rms, 0.999 * rms.low) == "does_not"


def test_holm_steps_down() -> None:
    from scipy.special import ndtri

    z = -ndtri(np.array([0.01, 0.5, 0.04, 0.03]) / 2.0)
    std = np.array([1.0, np.nan, 1.0, 1.0])
    keys = tuple(("joint_offset", f"j{i}", "offset") for i in range(4))
    found = Difference(keys, (), z, std, np.eye(4), np.eye(4), np.inf)
    np.testing.assert_allclose(found.family_p, [0.03, np.nan, 0.06, 0.06], rtol=1e-6)


def test_what_is_the_robots_own_on_any_day() -> None:
    """No place, instrument, board or clock of a day, and no tuning by which others change meaning."""
    of_a_day = {"base", "tool", "base_drift", "warm_up", "step", "gear_ripple"}
    read = {"tracker_scale", "tracker_drift"}
    cameras = {"focal", "principal_point", "distortion", "board_scale"}
    own = {kind for kind in EFFECTS if lasting((kind, "here", "value"))}
    assert EFFECTS.keys() - own == of_a_day | read | cameras
    assert not lasting(("nobody_knows", "here", "value"))
