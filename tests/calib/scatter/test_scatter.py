"""Levels of noise against dense algebra and against what was drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib.arm.se3 import so3_exp
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Repeatability
from calib.identification.variances import variance_components
from calib.instruments import TRACKER
from calib.linear import LinearProblem
from calib.model import Model
from calib.poses import Poses, poses_at
from calib.scatter import Scatter, Variances, scatter_of
from tests.helpers import random_robot

SIGMA = 1e-5


@dataclass(frozen=True)
class Day:
    """Rows of a linear model with their covariance by dense algebra, parts by level.

    H : ndarray, shape (N, n + 6), levers; visit, place : ndarray of int, shape (N,), of each row
    """

    poses: Poses
    H: Array
    visit: Array
    place: Array

    def covariance(self, scale: float, approach: Array, configuration: Array) -> Array:
        """Of all rows, (N, N), entry by entry; variances of the levers, (n + 6,)."""
        of_visit = (self.H * approach) @ self.H.T * (self.visit[:, None] == self.visit)
        of_place = (self.H * configuration) @ self.H.T * (self.place[:, None] == self.place)
        return np.asarray(scale**2 * np.eye(len(self.H)) + of_visit + of_place)


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


def scattering(poses: Poses, markers: int = 3) -> tuple[Scatter, Array, Day]:
    """Levers of poses, the same whitened, and the day by its rows."""
    scatter = scatter_of(arm(markers), np.zeros(0), poses, Variances.none(3))
    weighted = scatter.levers.reshape(len(poses), 3 * markers, -1) / SIGMA
    rows = weighted.shape[1]
    day = Day(
        poses,
        weighted.reshape(-1, weighted.shape[-1]),
        np.repeat(scatter.approach, rows),
        np.repeat(scatter.configuration, rows),
    )
    return scatter, weighted, day


def spread_over(levers: Array, joints: int) -> Array:
    """Variances (n + 2,) given to each of the n + 6 levers."""
    return np.concatenate([levers[:joints], np.repeat(levers[joints:], 3)])


APPROACH = np.array([0.0, 3e-5, 0.0, 1e-5, 5e-5]) ** 2
PLACE = np.array([2e-5, 0.0, 0.0, 0.0, 8e-5]) ** 2


def test_levers_are_what_small_displacements_do() -> None:
    """Joints turned and the tip displaced by hand, by exponentials."""
    poses = visits_of(4, 1, 1)
    scatter, _, _ = scattering(poses)
    model = arm()
    at = model.predict(np.zeros(0), poses)
    tip = model.state(np.zeros(0), poses).frames.o[:, -1:]
    for k in range(3):
        q = poses.q.copy()
        q[:, k] += 1e-6
        moved = (model.predict(np.zeros(0), replace(poses, q=q)) - at) / 1e-6
        np.testing.assert_allclose(scatter.levers[..., k], moved, atol=1e-5)
        turn = so3_exp(1e-6 * np.eye(3)[k])
        turned_by = ((at - tip) @ turn.T + tip - at) / 1e-6
        np.testing.assert_allclose(scatter.levers[..., 6 + k], turned_by, atol=1e-5)


def test_poses_that_do_not_count_change_nothing() -> None:
    poses = visits_of(5, 2, 2)
    scatter, weighted, _ = scattering(poses)
    known = scatter.at(Variances(1.3, APPROACH, PLACE))
    kept = np.ones(len(poses), dtype=bool)
    kept[[3, 8]] = False
    hidden = weighted * kept[:, None, None]
    rows = np.random.default_rng(1).normal(size=weighted.shape[:2])[..., None] * kept[:, None, None]
    mixed = known.mixing(hidden)(rows)
    alone = known.take(kept).mixing(weighted[kept])(rows[kept])
    np.testing.assert_allclose(mixed[kept], alone, atol=1e-9)
    assert not mixed[~kept].any()


def linear_of(r: Array, X: Array) -> LinearProblem:
    """Rows (m, R) of columns (m, R, k), nothing known beside them."""
    return LinearProblem(r, X, np.eye(X.shape[-1]))


def drawn(day: Day, scale: float, approach: Array, place: Array, seed: int) -> Array:
    """Rows of one day."""
    V = day.covariance(scale, spread_over(approach, 3), spread_over(place, 3))
    return np.asarray(np.linalg.cholesky(V) @ np.random.default_rng(seed).normal(size=len(V)))


@pytest.mark.long
@pytest.mark.parametrize(
    ("approaches", "readings", "scale", "approach", "place", "said"),
    [
        (2, 1, 1.0, 0.0, 0.0, "instrument"),
        (2, 1, 1.6, 0.0, 0.0, "instrument"),
        (3, 1, 1.0, 3e-5, 0.0, "approach"),
        (3, 1, 1.0, 0.0, 3e-5, "configuration"),
        (1, 3, 1.0, 0.0, 3e-5, "configuration"),
    ],
)
def test_each_level_is_told_from_the_others(
    approaches: int,
    readings: int,
    scale: float,
    approach: float,
    place: float,
    said: str,
) -> None:
    """Ten days of each kind: at most one is taken for another."""
    scatter, weighted, day = scattering(visits_of(25, approaches, readings))
    at_tip = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    right = 0
    for seed in range(10):
        y = drawn(day, scale, approach**2 * at_tip, place**2 * at_tip, seed)
        r = y.reshape(weighted.shape[:2])
        found = variance_components(scatter, weighted, linear_of(r, weighted[..., :3]), arm().robot)
        v = found.variances
        level = "instrument"
        if v.configuration.any():
            level = "configuration"
        elif v.approach.any():
            level = "approach"
        right += level == said and v.scale == pytest.approx(scale, rel=0.15)
        if level != "instrument" and level == said:
            size = scatter.of_tip(v.approach + v.configuration).translation
            assert size == pytest.approx(max(approach, place), rel=0.25)
    assert right >= 9


def test_a_known_arm_is_not_estimated() -> None:
    """What the cell says is kept, and what comes beside it counts with the configurations."""
    scatter, weighted, day = scattering(visits_of(25, 2, 1))
    at_tip = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    y = drawn(day, 1.0, (3e-5) ** 2 * at_tip, np.zeros(5), 1)
    r = y.reshape(weighted.shape[:2])
    linear, known = linear_of(r, weighted[..., :3]), Repeatability(3e-5, 0.0)
    found = variance_components(scatter, weighted, linear, arm().robot, known)
    assert scatter.of_tip(found.variances.approach).translation == pytest.approx(3e-5)
    assert not found.estimated


def test_one_marker_read_once_tells_nothing_apart() -> None:
    scatter, weighted, _ = scattering(visits_of(30, 1, 1), markers=1)
    r = np.random.default_rng(0).normal(size=weighted.shape[:2])
    assert not variance_components(
        scatter, weighted, linear_of(r, weighted[..., :2]), arm(1).robot
    ).instrument_seen
    scatter, weighted, _ = scattering(visits_of(30, 1, 2), markers=1)
    r = np.random.default_rng(0).normal(size=weighted.shape[:2])
    assert variance_components(
        scatter, weighted, linear_of(r, weighted[..., :2]), arm(1).robot
    ).instrument_seen
