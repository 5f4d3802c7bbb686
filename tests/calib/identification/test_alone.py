"""A posture that stands alone is not set aside because it stands alone; what is wrong still is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.identification.outliers import (
    _alone,
    extrapolation_factor,
    fit_statistics,
    pose_statistics,
)
from calib.model.build import build
from calib.noise import Noise
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot, stage_of, with_effects

SIGMA = 2e-5
ALONE = 7


def day(seed: int, m: int, lacking: float = 0.0) -> tuple[Cell, Measurements]:
    """Poses of an arm, one of them alone in joint 3; couplings that the model lacks, rad/rad."""
    rng = np.random.default_rng(seed)
    cell = cell_of(
        random_robot(rng, 6), rng.uniform(-0.15, 0.15, (3, 3)), ("base", "tool", "geometry")
    )
    q = rng.uniform(-1.4, 1.4, (m, 6))
    q[:, 2] = rng.uniform(-1.6, 0.1, m)
    q[ALONE, 2] = 1.6
    poses = with_moves(poses_at(q))
    model = build(with_effects(cell, *cell.effects, "joint_coupling"), poses).model
    of = [p.effect == "joint_coupling" for p in model.parameters]
    values = np.where(of, lacking * rng.normal(size=len(of)), 0.0)
    return cell, drawn_readings(model, values, poses, Noise.isotropic(SIGMA), rng)


@pytest.mark.parametrize("m", [24, 40])
def test_what_a_model_lacks_does_not_set_it_aside(m: int) -> None:
    """By a test that knows of no extrapolation 10 of 20 go where poses are few."""
    out = [calib.identify(*day(seed, m, 1e-4)).fit.outlier[ALONE] for seed in range(8)]
    assert sum(out) <= 1


@pytest.mark.parametrize("at", [ALONE, 3])
@pytest.mark.parametrize("m", [24, 40])
def test_a_slip_is_found_there_and_elsewhere(m: int, at: int) -> None:
    for seed in range(4):
        cell, data = day(seed, m)
        points = data.readings.copy()
        points[at, 1] += [0.0, 0.6e-3, -0.8e-3]
        found = calib.identify(cell, replace(data, readings=points)).fit.outlier
        assert list(np.flatnonzero(found)) == [at]


def test_the_end_of_a_grid_is_not_alone() -> None:
    levels = np.append(np.repeat(np.linspace(-1.0, 1.0, 5), 4), 1.5)
    q = np.column_stack([levels, np.linspace(-1.0, 1.0, 21)])
    assert list(_alone(poses_at(q))) == []
    q[-1, 0] = 2.0
    ((readings, far),) = _alone(poses_at(q))
    assert (list(np.flatnonzero(readings)), far) == ([20], 0.5)


def lack(data: Measurements, seed: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    rng = np.random.default_rng(seed)
    m = len(data)
    J = np.zeros((m, 9, 3))
    J[:, :3], J[:, 3:6], J[:, 6:] = (np.cos(k * data.poses.q[:, :3, None]) for k in (1, 2, 3))
    J[..., 0] = 1.0
    kept = np.ones(m, dtype=bool)
    r = rng.normal(size=(m, 9))
    known = np.zeros(0), np.zeros((0, 3))
    statistics = np.where(data.poses.q[:, 0] == data.poses.q[ALONE, 0], 10.0, 1.0)
    return extrapolation_factor(data.poses, r, J, kept, np.eye(3), known, statistics)


def test_only_what_stands_alone_is_forgiven_and_noise_alone_little() -> None:
    _, data = day(0, 40)
    found = np.array([lack(data, seed) for seed in range(20)])
    others = np.arange(40) != ALONE
    np.testing.assert_array_equal(found[:, others], 1.0)
    assert (found >= 1.0).all()
    assert np.median(found[:, ALONE]) < 2.5
    twice = data.take(np.append(np.arange(40), ALONE))
    both = lack(twice, 0)[[ALONE, 40]]
    assert both[0] == both[1] > 1.0


def test_weights_of_none_and_of_one() -> None:
    rng = np.random.default_rng(1)
    r, J = rng.normal(size=(12, 6)), rng.normal(size=(12, 6, 4))
    cov = np.linalg.inv(np.einsum("mri,mrj->ij", J, J))
    none, half, one = (fit_statistics(r, J, np.full(12, w), cov)[0] for w in (0.0, 0.7, 1.0))
    predicted = np.eye(6) + J @ cov @ np.swapaxes(J, -1, -2)
    squares = (r * np.linalg.solve(predicted, r[..., None])[..., 0]).sum(axis=-1)
    np.testing.assert_allclose(none, squares / 6.0)
    every = np.ones(12, dtype=bool)
    held = np.zeros((0, 4))
    np.testing.assert_allclose(one, pose_statistics(r, J, every, np.eye(4), held)[0])
    assert ((none <= half) & (half <= one)).all()


def test_a_pose_weighed_down_is_judged_as_one_left_out() -> None:
    """Its residual is a prediction: over what a fitted one leaves, it stood out the more alone."""
    cell, data = day(2, 40, 1e-4)
    stage = stage_of(cell, data)
    left = replace(stage, dropped=np.arange(40) == ALONE)
    without = left.fit(())
    weighed = replace(without, weight=np.where(left.dropped, 1e-6, 1.0))
    np.testing.assert_allclose(
        stage.statistics(weighed)[ALONE], left.statistics(without)[ALONE], rtol=1e-6
    )
