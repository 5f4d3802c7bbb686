"""Repeated readings of an arm that does not return exactly: false alarms, and drift all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.drift import DriftTest, drift_of
from calib.poses import Measurements, Poses, poses_at
from calib.poses.moves import visits, with_moves
from calib.scatter import Scatter, Variances
from tests.helpers import all_seen

SIGMA, ARM = 1e-5, 2e-5  # m
PLACES, MARKERS = 5, 3
TIP = 3 + np.arange(3)  # of three joints: levers of the tip's place


def session() -> Poses:
    """Five places, and all of them approached again, a minute a move."""
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (PLACES, 3))
    return with_moves(poses_at(np.tile(q, (2, 1)), time=60.0 * np.arange(2 * PLACES)))


def arm_of(poses: Poses, std: float) -> Scatter:
    """An arm whose tip comes elsewhere at each approach, and never turns."""
    levers = np.zeros((len(poses), MARKERS, 3, 9))
    levers[..., np.arange(3), TIP] = 1.0
    variances = Variances.none(3)
    variances.approach[3] = std**2
    lengths, tip = np.ones((MARKERS, 3), dtype=bool), np.zeros((len(poses), 6, 9))
    return Scatter(levers, lengths, tip, visits(poses), poses.configuration, variances)


def read(poses: Poses, rng: np.random.Generator, drift: float = 0.0) -> Measurements:
    """Points that stand anywhere, the same at equal joints; drift : m a minute, along one line."""
    places = rng.normal(size=(PLACES, MARKERS, 3))
    points = np.tile(places, (2, 1, 1)) + SIGMA * rng.normal(size=(len(poses), MARKERS, 3))
    points += ARM * rng.normal(size=(len(poses), 1, 3))
    points[..., 0] += drift * np.arange(len(poses))[:, None]
    return all_seen(poses, points)


def judged(data: Measurements, arm: Scatter | None) -> DriftTest:
    found = drift_of(data, weights(data), arm)
    assert found is not None
    return found


def weights(data: Measurements) -> Array:
    return np.eye(3) / SIGMA * data.seen[..., None, None]


def test_an_arms_own_scatter_is_no_drift() -> None:
    """A test of 1 % on 100 days: against the instrument alone it fails in more than half of them."""
    rng, poses = np.random.default_rng(2), session()
    arm = arm_of(poses, ARM)
    days = [read(poses, rng) for _ in range(100)]
    assert [judged(day, arm).verdict for day in days].count("steady") >= 95
    assert [judged(day, None).verdict for day in days].count("steady") < 50
    p = np.array([judged(day, arm).p for day in days])
    assert 0.35 < np.mean(p < 0.5) < 0.65


def test_a_drift_beyond_the_arm_is_found() -> None:
    rng, poses = np.random.default_rng(3), session()
    arm = arm_of(poses, ARM)
    verdicts = [judged(read(poses, rng, 6.0 * ARM / PLACES), arm).verdict for _ in range(20)]
    assert verdicts.count("drift") >= 18


def test_motions_are_as_uncertain_as_instrument_and_arm() -> None:
    rng, poses = np.random.default_rng(4), session()
    data = read(poses, rng)
    data = replace(
        data, seen=data.seen & (np.arange(len(poses)) != 7)[:, None] | [True, True, False]
    )
    std = np.sqrt(2.0 * (SIGMA**2 / MARKERS + ARM**2))
    for series in judged(data, arm_of(poses, ARM)).series:
        (motion,) = series.motions()
        if motion.markers == MARKERS:
            np.testing.assert_allclose(motion.translation_std, std, rtol=1e-6)
        else:
            unequal = np.sqrt(SIGMA**2 / 2 + ARM**2 + SIGMA**2 / 2 + ARM**2)
            np.testing.assert_allclose(motion.translation_std, unequal, rtol=0.05)
            assert motion.markers == MARKERS - 1


@pytest.mark.parametrize("std", [0.0, ARM])
def test_the_points_noise_is_told_beside_the_arm(std: float) -> None:
    """A reading shifted as a whole says nothing of single points."""
    rng, poses = np.random.default_rng(5), session()
    assert judged(read(poses, rng), arm_of(poses, std)).noise_factor == 1.0
