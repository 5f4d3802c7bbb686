"""Predicted covariance against a thousand full refits of the paper's experiment (Tables II to IV)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calib import Cell, Poses
from calib.covariance import covariance
from calib.identify.solver import levenberg_marquardt
from calib.observations import Points
from calib.se3 import Array
from studies.demo import simulated
from tests.helpers import with_effects

TRIALS = 1000
SIGMA = 1e-5  # m: the paper's 0.01 mm


def refits(cell: Cell, plan: Poses) -> tuple[Array, Array, Array]:
    """Estimates (trials, p) of full nonlinear refits, the truth (p,), and the predicted covariance."""
    data, model, truth = simulated(cell, plan, 0)
    exact = model.predict(truth, data.poses)
    weights = np.broadcast_to(np.eye(3) / SIGMA, (*data.seen.shape, 3, 3))
    p, rng = len(truth), np.random.default_rng(1)
    start, span = truth * 0.9, np.eye(p)
    estimates = []
    for _ in range(TRIALS // 50):
        noisy = exact + SIGMA * rng.standard_normal((50, *exact.shape))
        observation = Points(model, replace(data, points=noisy), weights)
        found = levenberg_marquardt(observation.flat, np.tile(start, (50, 1)), span)
        assert found.converged.all()
        estimates.append(found.values)
    _, J = Points(model, data, weights).flat(truth)
    return np.concatenate(estimates), truth, covariance(J, span)


@pytest.mark.parametrize("geometry", [False, True], ids=["elastostatic", "with geometry"])
def test_prediction_and_simulation_agree(kr270: Cell, table_two: Poses, geometry: bool) -> None:
    effects = [e for e in kr270.effects if geometry or e != "geometry"]
    estimates, truth, cov = refits(with_effects(kr270, *effects), table_two)
    std = np.sqrt(np.diag(cov))

    bias = (estimates.mean(axis=0) - truth) / (std / np.sqrt(TRIALS))
    assert np.abs(bias).max() < 4.0, "the mean error lies within Monte Carlo error"

    ratio = estimates.var(axis=0, ddof=1) / std**2
    low, high = chi2.ppf([0.0005, 0.9995], TRIALS - 1) / (TRIALS - 1)
    assert (ratio > low).all(), "every variance inside its 99.9 % chi-square band"
    assert (ratio < high).all()
    assert ratio.mean() == pytest.approx(1.0, abs=0.03), "within 3 % of the Cramer-Rao bound"

    whitened = np.linalg.solve(np.linalg.cholesky(cov), (estimates - truth).T)
    total, dof = float((whitened**2).sum()), TRIALS * len(truth)
    assert 1e-3 < chi2.cdf(total, dof) < 1.0 - 1e-3, "the whole covariance, correlations included"
