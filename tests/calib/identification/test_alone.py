"""A posture that stands alone is not set aside because it stands alone; what is wrong still is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.model.build import build
from calib.noise import Noise
from calib.poses import poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot, with_effects

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
