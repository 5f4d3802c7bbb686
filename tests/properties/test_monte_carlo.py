"""Predicted covariance against a thousand full refits of the paper's experiment (Tables II to IV)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calib import Cell, Poses
from studies.compare.experiment import POINTS, SimulatedExperiment, experiment_of, predict
from studies.compare.simulate import refits
from tests.helpers import simulated

pytestmark = pytest.mark.long

TRIALS = 1000


def demonstration(cell: Cell, plan: Poses) -> SimulatedExperiment:
    """The demonstration's truth, a base far off included; fits start a tenth away from it."""
    _, _, truth = simulated(cell, plan, 0)
    return replace(experiment_of(cell, plan), truth=truth, nominal=0.9 * truth)


def test_prediction_and_simulation_agree(kr270: Cell, table_two: Poses) -> None:
    experiment = demonstration(kr270, table_two)
    prediction = predict(replace(experiment, nominal=experiment.truth), POINTS)
    done = refits(experiment, [prediction], TRIALS, seed=1)
    assert done["points"].settled.all()
    errors, cov = done["points"].errors, prediction.covariance
    std = np.sqrt(np.diag(cov))

    bias = errors.mean(axis=0) / (std / np.sqrt(TRIALS))
    assert np.abs(bias).max() < 4.0, "the mean error lies within Monte Carlo error"

    ratio = errors.var(axis=0, ddof=1) / std**2
    low, high = chi2.ppf([0.0005, 0.9995], TRIALS - 1) / (TRIALS - 1)
    assert (ratio > low).all(), "every variance inside its 99.9 % chi-square band"
    assert (ratio < high).all()
    assert ratio.mean() == pytest.approx(1.0, abs=0.03), "within 3 % of the Cramer-Rao bound"

    whitened = np.linalg.solve(np.linalg.cholesky(cov), errors.T)
    total, dof = float((whitened**2).sum()), TRIALS * errors.shape[1]
    assert 1e-3 < chi2.cdf(total, dof) < 1.0 - 1e-3, "the whole covariance, correlations included"
