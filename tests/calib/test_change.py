"""Changes of a robot between two days, against a truth composed by plain matrices.

The arm is a chain of joints about z behind origins of its own (:mod:`tests.plain_arm`): nothing that
makes the readings is known to the estimator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

import calib
from calib import Cell, Measurements, change
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.change import FALSE_ALARM, Changes, DayEstimate, Difference, changes, known_of
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


def markers_at(q: Array, T: Array, markers: Array) -> Array:
    """Of the chain behind a frame, (m, 3, 3)."""
    frames = [T @ rpy_pose(ORIGINS, row) for row in q]
    return np.array([markers @ F[:3, :3].T + F[:3, 3] for F in frames])


def measured(
    seed: int, instrument: Array = INSTRUMENT, offsets: Sequence[float] = (0,) * 6,
    markers: Array = MARKERS, still: bool = False,
) -> Measurements:  # fmt: skip
    """Readings of a day, m: T_instrument T_arm(q + offsets) marker + noise; still : is joint 4."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.8, 1.8, (30, 6))
    q[:, 3] = 0.4 if still else q[:, 3]
    points = markers_at(q + np.array(offsets), instrument, markers)
    return all_seen(poses_at(q), points + SIGMA * rng.standard_normal(points.shape))


@pytest.fixture(scope="module")
def cell() -> Cell:
    origins = np.array([rpy_pose([origin], np.zeros(0)) for origin in ORIGINS])
    robot = light_chain(origins, np.tile([-2.0, 2.0], (6, 1)))
    return cell_of(robot, MARKERS, ["base", "tool", "geometry"], SIGMA)


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
        assert change.verdict(found.kept[1], 1e-4) == "holds"
        assert not found.difference.moved.any()
        assert found.there.low == 0.0
    assert found.difference.apart == ("base:base",)
    assert all(key[0] != "base" for key in found.difference.keys)


def test_a_slipped_belt_is_seen_and_sized(cell: Cell, before: DayEstimate) -> None:
    slip = 1.5e-4 * np.eye(6)[2]
    # What the slip does at the targets, by plain matrices about the true arm. Where the instrument
    # stands elsewhere, the base is placed anew and takes up a part.
    q = targets_of(cell)[0].q
    off = markers_at(q + slip, np.eye(4), MARKERS) - markers_at(q, np.eye(4), MARKERS)
    true = float(np.sqrt((off**2).sum(axis=-1).mean()))
    for instrument in (INSTRUMENT, ELSEWHERE):
        found = compared(cell, before, measured(4, instrument, slip))
        assert found.difference.p_value < FALSE_ALARM
        assert found.difference.moved.any()
        assert change.verdict(found.kept[1], 5e-6) == "does_not"
        if instrument is INSTRUMENT:
            assert found.there.low < true < found.there.high
            assert found.there.value == pytest.approx(true, rel=0.15)
        else:
            assert found.there.value < true


def test_a_knock_of_the_base_is_one_of_the_instrument(cell: Cell, before: DayEstimate) -> None:
    knock = shift(1e-4, -5e-5, 2e-4) @ turn("x", 1e-4) @ turn("y", -2e-4)
    found = compared(cell, before, measured(5, INSTRUMENT @ knock))
    assert {effect for effect, _, _ in moved_in(found)} == {"base"}
    # Of the knock nothing is left where the instrument was put elsewhere: nobody can tell.
    hidden = compared(cell, before, measured(5, ELSEWHERE @ knock))
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
    poor = known_of(calib.identify(cell, measured(12, offsets=truth, still=True)))
    assert poor.lost.any()
    found = compared(cell, poor, measured(13, offsets=truth)).difference
    assert len(found.whitened) < len(found.keys)
    assert found.p_value > FALSE_ALARM
    assert not found.moved.any()
    assert np.isnan(found.std).any()


# -- The statistics of a difference, on estimates that are known to be normal


def drawn(rng: np.random.Generator, cov: Array, moved: Array | float = 0.0) -> DayEstimate:
    """An estimate of joint offsets."""
    k = len(cov)
    keys = tuple(("joint_offset", f"j{i}", "offset") for i in range(k))
    values = rng.multivariate_normal(np.zeros(k), cov) + moved
    return DayEstimate(keys, values, cov, np.zeros(k, dtype=bool), {}, np.inf)


def test_false_alarms_are_held_over_all_parameters() -> None:
    rng, k = np.random.default_rng(3), 25
    covs = [1e-10 * (M @ M.T + 0.1 * np.eye(k)) for M in rng.normal(size=(2, k, k))]

    def differences(count: int, moved: Array | float = 0.0) -> list[Difference]:
        days = ((drawn(rng, covs[0]), drawn(rng, covs[1], moved)) for _ in range(count))
        return [change.difference(*both) for both in days]

    found = differences(800)
    alarms = np.mean([one.p_value < FALSE_ALARM for one in found])
    assert 0.008 < alarms < 0.034
    assert np.mean([one.moved.any() for one in found]) <= alarms
    e = np.eye(k)[0]  # a known shift of noncentrality 60 is seen
    moved = e * np.sqrt(60.0 / (e @ np.linalg.solve(covs[0] + covs[1], e)))
    assert np.mean([one.p_value < FALSE_ALARM for one in differences(100, moved)]) > 0.95


def test_a_difference_small_by_luck_still_may_hide_something() -> None:
    """By the inversion alone the upper end would be zero."""
    rows, weights, cov = np.ones((5, 3, 4)), np.ones(5), np.eye(4)
    found, usual = (change.errors_at(rows, np.full(4, d), cov, weights)[0] for d in (1e-6, 1.0))
    assert found.value == found.low == 0.0
    assert 0.5 * usual.high < found.high < usual.high


def test_results_of_two_models_are_refused() -> None:
    one = drawn(np.random.default_rng(4), np.eye(3))
    other = replace(one, keys=(("backlash", "j1", "half_width"), *one.keys[1:]))
    with pytest.raises(CalibError, match=r"lacks backlash:j1.half_width, joint_offset:j0"):
        change.difference(one, other)
    none = replace(one, keys=tuple(("base", "base", name) for name in "xyz"))
    with pytest.raises(CalibError, match="no parameter of the robot in common"):
        change.difference(none, none)


def test_intervals_hold_the_truth() -> None:
    rng, k = np.random.default_rng(5), 8
    M = rng.normal(size=(k, k))
    cov, rows, weights = M @ M.T, rng.normal(size=(12, 3, k)), rng.uniform(0.5, 2.0, 12)
    root = np.linalg.cholesky(cov)
    for size in (0.0, 0.5, 2.0, 10.0):
        delta = size * rng.normal(size=k)
        true = np.sqrt((weights @ ((rows @ delta) ** 2).sum(axis=1)) / weights.sum())
        inside = []
        for _ in range(100):
            values = delta + root @ rng.standard_normal(k)
            rms, worst = change.errors_at(rows, values, cov, weights)
            inside.append(rms.low <= true + 1e-12 and true <= rms.high)
            assert worst.high >= rms.value
        assert np.mean(inside) > 0.89
    assert change.verdict(rms, rms.high) == "holds"
    assert change.verdict(rms, 0.999 * rms.high) == "cannot_be_said"
    assert change.verdict(rms, 0.999 * rms.low) == "does_not"


def test_holm_steps_down() -> None:
    z = -ndtri(np.array([0.01, 0.5, 0.04, 0.03]) / 2.0)
    keys = tuple(("joint_offset", f"j{i}", "offset") for i in range(4))
    std = np.array([1.0, np.nan, 1.0, 1.0])
    found = Difference(keys, (), z, std, np.eye(4), np.eye(4), np.inf)
    np.testing.assert_allclose(found.family_p, [0.03, np.nan, 0.06, 0.06], rtol=1e-6)


def test_what_is_the_robots_own_on_any_day() -> None:
    """No place, instrument, board or clock of a day, and no tuning by which others change meaning."""
    of_a_day = {"base", "tool", "base_drift", "warm_up", "step", "gear_ripple", "tracker_scale"}
    of_a_day |= {"tracker_drift", "focal", "principal_point", "distortion", "board_scale"}
    own = {kind for kind in EFFECTS if change.lasting((kind, "here", "value"))}
    assert EFFECTS.keys() - own == of_a_day
    assert not change.lasting(("nobody_knows", "here", "value"))


def test_what_was_not_determined_is_no_noise() -> None:
    """Of a day that left one parameter open at its plausible size, and another that follows it."""
    keys = [("joint_offset", joint, "offset") for joint in ("a", "b")]
    noise, follows = np.diag([4.0, 0.0]), np.array([1.5, 2.0])
    covariance = noise + np.outer(follows, follows)
    lost = np.array([False, True])
    day = DayEstimate(tuple(keys), np.zeros(2), covariance, lost, {}, np.inf)
    alone, opened = day.by_noise(keys, keys[1:])
    np.testing.assert_allclose(alone, noise, atol=1e-12)
    np.testing.assert_allclose(opened[:, 0], follows)
