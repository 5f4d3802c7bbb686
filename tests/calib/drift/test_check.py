"""Repeated readings: closed forms, a plain least squares, false alarms, and drift that was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.drift import DriftTest, drift_of
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


def judged(data: Measurements) -> DriftTest:
    found = drift_of(data, np.eye(3) / SIGMA * data.seen[..., None, None])
    assert found is not None
    return found


def hidden(data: Measurements, rng: np.random.Generator, share: float) -> Measurements:
    seen = rng.uniform(size=data.seen.shape) > share
    return replace(data, seen=seen, readings=data.points * seen[..., None])


@pytest.mark.long
@pytest.mark.parametrize(
    ("markers", "rank", "share"), [(1, 3, 0.0), (2, 5, 0.0), (3, 6, 0.0), (2, 5, 0.2), (4, 6, 0.2)]
)
def test_no_drift_is_seldom_called_one(markers: int, rank: int, share: float) -> None:
    """p is uniform, of everything and of the trend."""
    rng = np.random.default_rng(markers)
    poses, p, trend = day(5, 1), [], []
    for _ in range(300):
        data = hidden(readings(poses, MARKERS[:markers] + 2.0, rng), rng, share)
        found = drift_of(data, np.eye(3) / SIGMA * data.seen[..., None, None])
        if found is None or not found.dof:
            continue
        if not share:
            assert found.dof == 4 * rank
        p.append(found.p)
        trend.append(found.trend_p)
    for values in (np.array(p), np.array(trend)):
        values = values[np.isfinite(values)]
        assert len(values) > 250
        assert kstest(values, "uniform").pvalue > 1e-3
        assert abs((values < 0.05).mean() - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / len(values))


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_sums_of_squares_are_those_of_plain_least_squares(share: float) -> None:
    """Points free, and a rigid motion of each later reading: one dense fit."""
    rng = np.random.default_rng(7)
    poses = day(4)
    data = hidden(readings(poses, MARKERS, rng), rng, share)
    here = poses.configuration == poses.configuration[0]
    points, seen = data.points[here], data.seen[here]

    def left(columns: list[Array]) -> tuple[float, int]:
        A = np.column_stack(columns)[np.repeat(seen.reshape(-1), 3)]
        b = points.reshape(-1)[np.repeat(seen.reshape(-1), 3)]
        x, _, rank, _ = np.linalg.lstsq(A, b, rcond=1e-9)
        return float(((b - A @ x) ** 2).sum() / SIGMA**2), int(rank)

    V, M = seen.shape
    fixed = list(np.tile(np.eye(3 * M), (V, 1)).T)
    mean = points.sum(axis=0) / np.maximum(seen.sum(axis=0), 1)[:, None]
    motions = []
    for axis in np.eye(3):
        for moved in (np.tile(axis, (M, 1)), np.cross(axis, mean)):
            for v in range(1, V):
                column = np.zeros((V, M, 3))
                column[v] = moved
                motions.append(column.reshape(-1))
    before, after = left(fixed), left(fixed + motions)
    found = judged(data)
    assert found.dof == after[1] - before[1]
    assert chi2.isf(found.p, found.dof) == pytest.approx(before[0] - after[0], rel=1e-5)


def test_a_known_motion_is_found() -> None:
    """Without noise to speak of, the motion that was put in, at the centroid."""
    rng = np.random.default_rng(3)
    poses = day(3, 1)
    data = readings(poses, MARKERS, rng)
    shift, turn = np.array([30e-6, -20e-6, 10e-6]), np.array([5e-5, 0.0, -8e-5])
    centre = MARKERS.mean(axis=0)
    moved = (MARKERS - centre) @ so3_exp(turn).T + centre + shift
    data.points[:] = MARKERS
    data.points[-1] = moved
    found = judged(data)
    still, last = found.series[0].motions()
    assert still.length == 0.0
    assert still.p == 1.0
    np.testing.assert_allclose(last.translation, shift, atol=1e-9)
    np.testing.assert_allclose(last.rotation, turn, atol=1e-8)
    np.testing.assert_allclose(last.translation_std, SIGMA * np.sqrt(2.0 / 4.0), rtol=1e-9)
    assert last.length == pytest.approx(np.sqrt(((moved - MARKERS) ** 2).sum(axis=1).mean()))
    assert (last.pose, last.time, last.rank) == ("ref3", 2400.0, 6)
    # One of three readings off by d leaves 2/3 of d^2 about their mean.
    total = 2.0 / 3.0 * ((moved - MARKERS) ** 2).sum() / SIGMA**2
    assert found.p == pytest.approx(chi2.sf(total, 12), rel=1e-3)


@pytest.mark.long
def test_standard_deviations_hold_and_two_markers_leave_a_turn_open() -> None:
    rng = np.random.default_rng(11)
    poses, line = day(2, 1), MARKERS[:2]
    z = []
    for _ in range(200):
        data = readings(poses, line, rng)
        (motion,) = judged(data).series[0].motions()
        assert motion.rank == 5
        along = (data.points[0, 1] - data.points[0, 0]) / np.linalg.norm(line[1] - line[0])
        assert abs(motion.rotation @ along) < 1e-12
        z.append(
            np.concatenate([motion.translation, motion.rotation])
            / np.append(motion.translation_std, motion.rotation_std)
        )
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.2)
    (single,) = judged(readings(poses, line[:1], rng)).series[0].motions()
    assert single.rank == 3
    assert not single.rotation.any()


def test_base_drift_is_found_at_its_rate() -> None:
    """The effect base_drift of the simulation, seen in the frame of a turned and distant station."""
    rng = np.random.default_rng(5)
    robot = random_robot(rng, 3)
    cell = cell_of(robot, MARKERS[:3], ("base", "base_drift"), SIGMA)
    poses = day(6)
    model = build(cell, poses).model
    values = np.zeros(len(model.parameters))
    values[:6] = [1.0, -2.0, 0.5, 0.4, -0.3, 1.1]
    rates = np.array([20e-6, -15e-6, 10e-6, 30e-6, 0.0, -10e-6]) / 3600.0
    values[6:] = rates
    deviations, verdicts = [], []
    for _ in range(60):
        data = drawn_readings(model, values, poses, cell.noise, rng)
        found = judged(data)
        verdicts.append(found.verdict)
        R = so3_exp(values[3:6])
        at = found.series[0].mean.mean(axis=0)
        turn = R @ rates[3:]
        shift = R @ rates[:3] + np.cross(turn, at - values[:3])
        rate = found.rates["base"]
        deviations.append(
            np.concatenate(
                [
                    (rate.translation - shift) / rate.translation_std,
                    (rate.rotation - turn) / rate.rotation_std,
                ]
            )
        )
    assert verdicts.count("drift") >= 58
    spread = np.array(deviations)
    assert np.abs(spread.mean(axis=0)).max() < 4.0 / np.sqrt(60)
    np.testing.assert_allclose(spread.std(axis=0), 1.0, atol=0.35)


def test_a_robot_that_does_not_return_does_not_drift() -> None:
    rng = np.random.default_rng(9)
    poses = day(8)
    verdicts = []
    for _ in range(100):
        data = readings(poses, MARKERS, rng)
        away = rng.normal(size=(len(poses), 1, 3)) * 4e-5
        verdicts.append(judged(replace(data, readings=data.points + away)).verdict)
    assert verdicts.count("moved") >= 95


def test_more_noise_than_stated_is_no_drift() -> None:
    rng = np.random.default_rng(13)
    poses = day(8)
    found = [judged(readings(poses, MARKERS, rng)) for _ in range(100)]
    louder = []
    for _ in range(100):
        data = readings(poses, MARKERS, rng)
        louder.append(judged(replace(data, readings=MARKERS + 2.0 * (data.points - MARKERS))))
    for some in (found, louder):
        assert [one.verdict for one in some].count("steady") >= 93
    assert np.median([one.noise_factor for one in louder]) == pytest.approx(2.0, rel=0.1)


def test_only_what_was_left_and_read_again_counts() -> None:
    rng = np.random.default_rng(1)
    q = np.zeros((4, 3))
    assert drift_of(readings(poses_at(q), MARKERS, rng), np.full((4, 4, 3, 3), 1e5)) is None
    away = poses_at(np.array([[0.0] * 3, [0.0] * 3, [1.0] * 3, [0.0] * 3]))
    data = readings(away, MARKERS, rng)
    found = judged(data)
    assert found.series[0].names == ("p0000", "p0003")
    np.testing.assert_allclose(found.series[0].points[0], data.points[:2].mean(axis=0))
    assert not found.rates
    loaded = replace(away, wrench=np.array([[0.0] * 6, [1.0] * 6, [0.0] * 6, [1.0] * 6]))
    assert judged(replace(data, poses=loaded)).series[0].names == ("p0001", "p0003")
    moved = replace(away, station=np.array([0, 0, 0, 1]), stations=("a", "b"))
    assert drift_of(replace(data, poses=moved), np.full((4, 4, 3, 3), 1e5)) is None


def test_time_gives_the_order() -> None:
    rng = np.random.default_rng(1)
    poses = day(3, 1)
    data = readings(poses, MARKERS, rng)
    turned = data.take(np.array([4, 1, 2, 3, 0]))
    assert judged(turned).series[0].names == ("ref1", "ref2", "ref3")
    assert judged(turned).p == pytest.approx(judged(data).p)


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
        found = judged(replace(data, readings=data.points + jump))
        assert (found.verdict, found.one_side) == ("moved", False)
    assert judged(readings(once, MARKERS, rng)).one_side


def test_readings_equal_to_the_last_digit_are_no_drift() -> None:
    """As a display coarser than the noise shows them: nothing moved, and nothing to compare with."""
    data = readings(day(4), MARKERS, np.random.default_rng(3))
    still = replace(data, readings=np.broadcast_to(MARKERS, data.readings.shape).copy())
    found = judged(still)
    assert found.verdict == "steady"
    assert found.p == 1.0
