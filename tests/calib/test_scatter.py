"""Levels of noise: against dense algebra, against what was drawn, drift, and whose it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.arm.repeatability import usual_repeatability
from calib.arm.se3 import so3_exp
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Repeatability
from calib.identification.drift import drift_p
from calib.identification.variances import variance_components
from calib.instruments import TRACKER
from calib.model import Model
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Scatter, Variances, parted, pose_to_pose, scatter_of
from calib.poses import Measurements, Poses, poses_at
from calib.poses.moves import with_moves
from calib.prediction.budget import budget_of
from calib.prediction.estimate import estimate_of
from tests.day import day, read_of
from tests.helpers import all_seen, cell_of, random_robot

SIGMA = 1e-5


def visits_of(places: int, approaches: int, readings: int) -> Poses:
    """Places that are all visited, then all visited again, each time read so often without a move."""
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (places, 3))
    return poses_at(np.repeat(np.tile(q, (approaches, 1)), readings, axis=0))


def arm(markers: int = 3) -> Model:
    """Of three joints, without any effect."""
    rng = np.random.default_rng(3)
    robot, names = random_robot(rng, 3), tuple(f"m{j}" for j in range(markers))
    places = rng.uniform(-0.2, 0.2, (markers, 3))
    return Model(robot, names, places, (), Payload(), np.zeros(3), (TRACKER,))


def scattering(poses: Poses, markers: int = 3) -> tuple[Scatter, Array]:
    """Levers of poses, and the same whitened, (m, rows, n + 6)."""
    scatter = scatter_of(arm(markers), np.zeros(0), poses, Variances.none(3))
    return scatter, scatter.levers.reshape(len(poses), 3 * markers, -1) / SIGMA


AT_TIP = np.array([0.0, 0.0, 0.0, 1.0, 0.0])


def test_levers_are_what_small_displacements_do() -> None:
    """Joints turned and the tip displaced by hand, by exponentials."""
    poses, model, none = visits_of(4, 1, 1), arm(), np.zeros(0)
    scatter, _ = scattering(poses)
    at, tip = model.predict(none, poses), model.state(none, poses).frames.o[:, -1:]
    for k in range(3):
        q = poses.q + 1e-6 * np.eye(3)[k]
        moved = (model.predict(none, replace(poses, q=q)) - at) / 1e-6
        np.testing.assert_allclose(scatter.levers[..., k], moved, atol=1e-5)
        turn = so3_exp(1e-6 * np.eye(3)[k])
        turned_by = ((at - tip) @ turn.T + tip - at) / 1e-6
        np.testing.assert_allclose(scatter.levers[..., 6 + k], turned_by, atol=1e-5)


def test_poses_that_do_not_count_change_nothing() -> None:
    poses = visits_of(5, 2, 2)
    scatter, weighted = scattering(poses)
    known = scatter.at(Variances(1.3, np.array([0, 9e-10, 0, 1e-10, 2.5e-9]), 6e-9 * AT_TIP))
    kept = ~np.isin(np.arange(len(poses)), [3, 8])
    hidden = weighted * kept[:, None, None]
    rows = np.random.default_rng(1).normal(size=weighted.shape[:2])[..., None] * kept[:, None, None]
    mixed = known.mixing(hidden)(rows)
    alone = known.take(kept).mixing(weighted[kept])(rows[kept])
    np.testing.assert_allclose(mixed[kept], alone, atol=1e-9)
    assert not mixed[~kept].any()
    apart = LinearProblem.of_rows(rows, known.mixing(hidden)).independent[1]
    np.testing.assert_array_equal(apart, mixed.reshape(len(apart), -1))


def test_a_known_arm_is_not_estimated() -> None:
    """What the cell says is kept, and what comes beside it counts with the configurations."""
    scatter, weighted = scattering(visits_of(25, 2, 1))
    rng = np.random.default_rng(1)
    came = 3e-5 * rng.normal(size=(50, 3, 1))  # the tip, at every approach
    r = (weighted[..., 3:6] @ came)[..., 0] + rng.normal(size=weighted.shape[:2])
    linear = LinearProblem(r, weighted[..., :3], np.eye(3))
    found = variance_components(scatter, weighted, linear, arm().robot, Repeatability(3e-5, 0.0))
    assert scatter.of_tip(found.variances.approach).translation == pytest.approx(3e-5)
    assert not found.estimated


@pytest.mark.parametrize("readings", [1, 2])
def test_one_marker_read_once_tells_nothing_apart(readings: int) -> None:
    scatter, weighted = scattering(visits_of(30, 1, readings), markers=1)
    r = np.random.default_rng(0).normal(size=weighted.shape[:2])
    linear = LinearProblem(r, weighted[..., :2], np.eye(2))
    found = variance_components(scatter, weighted, linear, arm(1).robot)
    assert found.instrument_seen == (readings == 2)


# -- Whose it is that a fit leaves from pose to pose, on arms in MuJoCo


def gear(size: float) -> Callable[[Array], Array]:
    """A shoulder that errs 30 times a turn, rad."""
    return lambda q: q + size * np.sin(30.0 * q[:, 1:2]) * (np.arange(q.shape[1]) == 1)


@pytest.mark.parametrize(
    ("scatter", "approaches", "error", "of"),
    [
        (3e-5, 1, 0.0, "undecided"),  # as arms of this size may repeat: nothing tells it
        (3e-5, 2, 0.0, "arm"),
        (1e-5, 2, 1e-4, "model"),  # re-approaches tell the arm: what is beside it is the model's
        (1e-5, 1, 6e-4, "model"),  # no arm of this size repeats so badly
    ],
)
def test_whose_it_is(scatter: float, approaches: int, error: float, of: str) -> None:
    session = {"scatter": scatter, "approaches": approaches, "truth": gear(error)}
    cell, data, _, _ = day("6R", seed=0, index=1, **session)
    found = calib.identify(cell, data)
    judged = pose_to_pose(found.levels, found.scatter, cell.robot.reach)
    assert judged.of == of
    assert (judged.arm is None) == (approaches == 1)
    targets, weights = calib.load_targets(cell, cell.path.with_name("targets.csv"))
    parts = budget_of(found, estimate_of(found), targets, weights).parts
    sizes = {part.source: float(np.sqrt((part.errors**2).mean())) for part in parts}
    misfit = sizes.get("what the model lacks, from the fitted poses", 0.0)
    assert (misfit > 0.0) == (of == "model")
    # RMS by which a gear error of the shoulder moves points about a metre away.
    assert misfit <= 1.5 * error
    own = sizes.get("repeatability of the arm", sizes.get("arm or model, from pose to pose", 0.0))
    assert own == pytest.approx(scatter if approaches == 2 or not error else 0.0, rel=0.4)


def test_parts_are_the_whole() -> None:
    whole = Variances(1.2, np.arange(8.0), np.arange(8.0)[::-1].copy())
    for of in ("model", "undecided", "arm"):
        own, lacks = parted(whole, of)
        np.testing.assert_array_equal(own.approach + lacks.approach, whole.approach)
        np.testing.assert_array_equal(own.configuration + lacks.configuration, whole.configuration)
        assert lacks.any == (of == "model")
    judged = pose_to_pose(None, None, 1.3)  # without levels the instrument is all that errs
    assert (judged.of, judged.arm, judged.rest) == ("instrument", None, None)
    assert judged.usual == usual_repeatability(1.3)


# -- Repeated readings: false alarms, and drift that was put in

MARKERS = np.array([[0.28, -0.02, -0.09], [0.28, -0.03, 0.10], [0.28, 0.13, 0.01], [0.1, 0.0, 0.1]])


def revisited(visits: int, between: int = 2) -> Poses:
    """A reference at joints zero, with other poses between its readings, ten minutes a move."""
    q = [np.zeros(3)]
    for v in range(visits - 1):
        q += [*(np.array([1.0 + v, 0.5 * k, -0.3]) for k in range(between)), np.zeros(3)]
    return with_moves(poses_at(np.array(q), time=600.0 * np.arange(len(q))))


def still(
    poses: Poses, rng: np.random.Generator, count: int = 4, noise: float = 1.0
) -> Measurements:
    """The same points read at every pose, with noise."""
    points = MARKERS[:count]
    return all_seen(poses, points + rng.normal(size=(len(poses), *points.shape)) * SIGMA * noise)


@pytest.mark.parametrize("markers", [1, 2, 4])
def test_no_drift_is_seldom_called_one(markers: int) -> None:
    rng = np.random.default_rng(markers)
    found = np.array([drift_p(still(revisited(5, 1), rng, markers)) for _ in range(300)])
    assert np.mean(found < 0.05) < 0.08
    assert np.mean(found < 0.01) < 0.03


def test_base_drift_is_found() -> None:
    """The effect base_drift of the simulation, seen in the frame of a turned and distant station."""
    rng = np.random.default_rng(5)
    cell = cell_of(random_robot(rng, 3), MARKERS[:3], ("base",), SIGMA)
    drift = np.array([20e-6, -15e-6, 10e-6, 30e-6, 0.0, -10e-6]) / 3600.0
    own = {"base": [1.0, -2.0, 0.5, 0.4, -0.3, 1.1], "base_drift": drift}
    poses = revisited(6)
    found = [drift_p(read_of(cell, poses, rng, "base_drift", **own)) for _ in range(60)]
    assert sum(p < 0.01 for p in found) >= 58


@pytest.mark.parametrize(("away", "noise"), [(4e-5, 1.0), (0.0, 2.0)])
def test_neither_a_robot_that_does_not_return_nor_more_noise_is_drift(
    away: float, noise: float
) -> None:
    rng, poses, alarms = np.random.default_rng(9), revisited(8), 0
    for _ in range(100):
        data = still(poses, rng, noise=noise)
        off = rng.normal(size=(len(poses), 1, 3)) * away
        alarms += drift_p(replace(data, readings=data.points + off)) < 0.01
    assert alarms <= 5


def test_only_what_was_left_and_read_again_counts_in_order_of_time() -> None:
    rng = np.random.default_rng(1)
    assert drift_p(still(poses_at(np.zeros((4, 3))), rng)) is None
    twice = revisited(3, 1)
    moved = replace(twice, station=np.arange(len(twice)), stations=tuple("abcde"))
    assert drift_p(replace(still(twice, rng), poses=moved)) is None
    data = still(revisited(4, 1), rng)
    turned = data.take(np.array([6, 1, 2, 3, 4, 5, 0]))
    assert drift_p(turned) == pytest.approx(drift_p(data))
    # As a display coarser than the noise shows them: nothing moved, and nothing to compare with.
    equal = np.broadcast_to(MARKERS, data.readings.shape).copy()
    assert drift_p(replace(data, readings=equal)) == 1.0


@pytest.mark.parametrize("sides", [(1, -1, 1, -1), (1, 1, -1, 1), (1, -1, -1, 1)])
def test_backlash_is_no_drift(sides: tuple[int, ...]) -> None:
    """Free and loaded readings that jump together, by the side from which the arm came."""
    rng, once = np.random.default_rng(17), revisited(4, 1)
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
        data = still(poses, rng)
        assert drift_p(replace(data, readings=data.points + jump)) > 0.01
