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
from calib.change import Changes, DayEstimate, changes, known_of
from calib.change.comparison import at_targets, verdict
from calib.change.difference import difference, holm, lasting
from calib.compensation.estimate import estimate_of
from calib.effects import EFFECTS
from calib.errors import CalibError
from calib.poses import poses_at
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


def compared(
    cell: Cell, before: DayEstimate, data: Measurements, tolerance: float | None = None
) -> Changes:
    found = calib.identify(cell, data)
    return changes(cell, before, known_of(found), estimate_of(found), tolerance)


def test_a_robot_that_stayed_raises_no_alarm(cell: Cell, before: DayEstimate) -> None:
    for seed, instrument in ((2, INSTRUMENT), (3, ELSEWHERE)):
        found = compared(cell, before, measured(seed, instrument), 1e-4)
        assert not found.difference.changed
        assert (found.told, found.cause, found.verdict) == ("none", None, "holds")
        assert not found.difference.changed_parameters.any()
        assert found.change.rms.low == 0.0
    assert found.difference.apart == ("base:base",)
    assert all(key[0] != "base" for key in found.difference.keys)


def test_a_slipped_belt_is_named_and_sized(cell: Cell, before: DayEstimate) -> None:
    slip = 1.5e-4
    for instrument in (INSTRUMENT, ELSEWHERE):
        found = compared(cell, before, measured(4, instrument, (0, 0, slip, 0, 0, 0)), 5e-6)
        assert found.told == "named"
        assert found.cause is not None
        assert (found.cause.cause.kind, found.cause.cause.where) == ("joint_offset", "j3")
        assert abs(found.cause.values[0] - slip) < 4.0 * found.cause.std[0] < 0.1 * slip
        assert found.verdict == "does_not"
        # What the slip does at the targets, by plain matrices about the true arm. Where the instrument
        # stands elsewhere, the base is placed anew and takes up a part.
        moved_by = []
        for q in found.targets.q:
            then, now = (rpy_pose(ORIGINS, q + s * np.eye(6)[2]) for s in (0.0, slip))
            points = [MARKERS @ T[:3, :3].T + T[:3, 3] for T in (then, now)]
            moved_by.append(((points[1] - points[0]) ** 2).sum(axis=1).mean())
        true = float(np.sqrt(np.mean(moved_by)))
        if instrument is INSTRUMENT:
            assert found.change.rms.low < true < found.change.rms.high
            assert found.change.rms.value == pytest.approx(true, rel=0.15)
        else:
            assert found.change.rms.value < true


def test_a_knock_of_the_base_is_one_of_the_instrument(cell: Cell, before: DayEstimate) -> None:
    knock = shift(1e-4, -5e-5, 2e-4) @ turn("x", 1e-4) @ turn("y", -2e-4)
    found = compared(cell, before, measured(5, knock=knock))
    assert found.cause is not None
    assert found.cause.cause.kind == "base"
    np.testing.assert_allclose(found.cause.values[:3], [1e-4, -5e-5, 2e-4], atol=2e-5)
    # Of the knock nothing is left where the instrument was put elsewhere: nobody can tell.
    hidden = compared(cell, before, measured(5, ELSEWHERE, knock=knock))
    assert hidden.told == "none"
    assert all(e.cause.kind != "base" for e in hidden.explanations)


def test_the_first_joints_zero_looks_like_a_turned_base(cell: Cell, before: DayEstimate) -> None:
    found = compared(cell, before, measured(6, offsets=(2e-4, 0, 0, 0, 0, 0)))
    assert found.cause is not None
    assert (found.cause.cause.kind, found.cause.cause.where) == ("joint_offset", "j1")
    # A link turned about the first axis does the same.
    assert {(c.kind, c.where) for c in found.same_as} == {("base", "base"), ("link_geometry", "j2")}


def test_markers_and_tools(cell: Cell, before: DayEstimate) -> None:
    bent = MARKERS + np.array([[0, 0, 0], [1e-4, 5e-5, 0], [0, 0, 0]])
    found = compared(cell, before, measured(7, markers=bent))
    assert found.cause is not None
    assert (found.cause.cause.kind, found.cause.cause.where) == ("marker", "m2")
    T = shift(1e-4, 0, -1e-4) @ turn("z", 1e-3)
    found = compared(cell, before, measured(8, markers=MARKERS @ T[:3, :3].T + T[:3, 3]))
    assert found.cause is not None
    assert found.cause.cause.kind == "tool"
    apart = compared(cell, before, measured(9, markers=MARKERS + np.array([0.05, 0.0, 0.0])))
    assert set(apart.difference.apart) == {f"tool:marker:m{j}" for j in (1, 2, 3)}
    assert apart.told == "none"


def test_a_worn_gear_leaves_more_than_before(cell: Cell, before: DayEstimate) -> None:
    found = compared(cell, before, measured(10, lost_motion=3e-4))
    assert found.difference.leaves_more
    quiet = compared(cell, before, measured(11))
    assert not quiet.difference.leaves_more


def harmonic(seed: int, joint: int, urad: float) -> tuple[Measurements, float]:
    """A day on which a joint errs once in its turn, and what that does at other poses, RMS, m."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    still = measured(seed)

    def read(q: Array) -> Array:
        return np.array(
            [
                MARKERS @ T[:3, :3].T + T[:3, 3]
                for T in (INSTRUMENT @ rpy_pose(ORIGINS, row) for row in q)
            ]
        )

    def wrong(q: Array) -> Array:
        return q + 1e-6 * urad * np.cos(q[:, joint] + phase)[:, None] * np.eye(6)[joint]

    q = still.poses.q
    others = rng.uniform(-2.0, 2.0, (100, 6))
    came = ((read(wrong(others)) - read(others)) ** 2).sum(axis=-1).mean()
    points = still.readings + read(wrong(q)) - read(q)
    return replace(still, readings=points), float(np.sqrt(came))


def test_what_may_hide_holds_for_an_effect_outside_the_model(
    cell: Cell, before: DayEstimate
) -> None:
    """A harmonic arises that no parameter can express."""
    held = []
    for seed in range(20, 28):
        data, came = harmonic(seed, 1 + seed % 5, 60.0)
        found = compared(cell, before, data)
        assert found.outside is not None
        held.append(came <= np.hypot(found.change.rms.high, found.outside))
    assert sum(held) >= 7


def test_a_difference_small_by_luck_still_may_hide_something() -> None:
    """By the inversion alone the upper end would be zero."""
    rows, weights, cov = np.ones((5, 3, 4)), np.ones(5), np.eye(4)
    found = at_targets(rows, np.full(4, 1e-6), cov, weights)
    usual = at_targets(rows, np.full(4, 1.0), cov, weights)
    assert found.rms.value == found.rms.low == 0.0
    assert 0.5 * usual.rms.high < found.rms.high < usual.rms.high
    assert (found.errors[:, 2] > 0.0).all()


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
    assert not found.difference.changed
    assert not found.difference.changed_parameters.any()
    assert (~found.difference.determined).any()


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
    alarms = np.mean([one.changed for one in found])
    assert 0.008 < alarms < 0.034
    assert np.mean([one.changed_parameters.any() for one in found]) <= alarms
    # A known shift of noncentrality 60 is seen.
    total = covs[0] + covs[1]
    e = np.eye(k)[0]
    shift_ = e * np.sqrt(60.0 / (e @ np.linalg.solve(total, e)))
    seen = [
        difference(drawn(rng, covs[0]), drawn(rng, covs[1], shift_)).changed for _ in range(100)
    ]
    assert np.mean(seen) > 0.95


def test_models_are_compared_in_what_both_have() -> None:
    """Zero is put in for what one result lacks, as a fit without it would have found."""
    rng = np.random.default_rng(4)
    J, theta = rng.normal(size=(60, 4)), np.array([1e-3, -2e-3, 5e-4, 0.0])
    y = J @ theta + 1e-5 * rng.standard_normal(60)
    keys = tuple(("joint_offset", f"j{i}", "offset") for i in range(3))
    more = (*keys, ("backlash", "j1", "half_width"))

    def fitted(columns: Array, names: tuple[tuple[str, str, str], ...]) -> DayEstimate:
        cov = 1e-10 * np.linalg.inv(columns.T @ columns)
        values = np.linalg.lstsq(columns, y, rcond=None)[0]
        return DayEstimate(names, values, cov, np.zeros(len(names), dtype=bool), {}, np.inf)

    small, large = fitted(J[:, :3], keys), fitted(J, more)
    found = difference(small, large)
    assert found.keys == keys
    np.testing.assert_allclose(found.change, 0.0, atol=1e-15)
    assert list(found.alone) == [more[3]]
    with pytest.raises(CalibError, match="no parameter of the robot in common"):
        difference(
            small, DayEstimate(more[3:], np.zeros(1), np.eye(1), np.zeros(1, dtype=bool), {}, 1.0)
        )


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
            found = at_targets(rows, delta + root @ rng.standard_normal(k), cov, weights)
            inside.append(found.rms.low <= true + 1e-12 and true <= found.rms.high)
            assert found.worst.high >= found.errors[:, 2].max() - 1e-12
        assert np.mean(inside) > 0.89
    assert verdict(found.rms, found.rms.high) == "holds"
    assert verdict(found.rms, 0.999 * found.rms.high) == "cannot_be_said"
    assert verdict(found.rms, 0.999 * found.rms.low) == "does_not"


def test_holm_steps_down() -> None:
    p = np.array([0.01, np.nan, 0.04, 0.03])
    np.testing.assert_allclose(holm(p), [0.03, np.nan, 0.06, 0.06])


def test_what_is_the_robots_own_on_any_day() -> None:
    """No place, instrument, board or clock of a day, and no tuning by which others change meaning."""
    of_a_day = {"base", "tool", "base_drift", "warm_up", "step", "gear_ripple"}
    read = {"tracker_scale", "tracker_drift"}
    cameras = {"focal", "principal_point", "distortion", "board_scale"}
    own = {kind for kind in EFFECTS if lasting((kind, "here", "value"))}
    assert EFFECTS.keys() - own == of_a_day | read | cameras
    assert not lasting(("nobody_knows", "here", "value"))
