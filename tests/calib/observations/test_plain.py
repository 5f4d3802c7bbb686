"""Approach pose in plain weighting: its covariance bears a chi-square test, and no right pose goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

import calib
from calib import Cell
from calib.model.build import build
from calib.poses import poses_at
from calib.simulation import drawn_readings
from tests.helpers import with_effects

DAYS = 15


def test_days_of_plain_poses_scatter_as_predicted(kr270: Cell) -> None:
    """Twelve poses under loads: first judged as if stiff, which sets bent poses aside for a while."""
    cell = with_effects(kr270, "base", "tool", "joint_compliance:A2,A3")
    cell = replace(cell, load=None)
    rng = np.random.default_rng(0)
    q = rng.uniform(*kr270.robot.limits.T, (12, 6))
    wrench = np.concatenate([rng.normal(size=(12, 3)) * 1500.0, np.zeros((12, 3))], axis=1)
    poses = poses_at(q, wrench=wrench)
    model = build(cell, poses).model
    truth = np.zeros(len(model.parameters))
    truth[-2:] = 3e-7, 4e-7
    squares, rank, outliers = 0.0, 0, 0
    for seed in range(DAYS):
        data = drawn_readings(model, truth, poses, cell.noise, np.random.default_rng(seed))
        found = calib.identify(cell, data, approach="pose", weighting="plain")
        outliers += int(found.fit.outlier.sum())
        error = (found.values - truth) / found.std
        values, vectors = np.linalg.eigh(found.correlation)
        squares += float(((error @ vectors) ** 2 / values).sum())
        rank += len(values)
    assert outliers <= 1
    assert 1e-3 < chi2.cdf(squares, rank) < 1.0 - 1e-3
