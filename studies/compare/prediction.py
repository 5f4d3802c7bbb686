"""Predicted covariance of a way, before anything is measured or simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.covariance import accuracy
from calib.identify.estimators import choose_directions
from calib.poses import Poses
from calib.se3 import Array
from studies.compare.experiment import Experiment, Way


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a way will know of the parameters.

    span : ndarray, shape (p, k), directions that the plan determines
    covariance : ndarray, shape (p, p), SI, zero for parameters that it leaves open
    """

    way: Way
    span: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """Standard deviations, shape (p,), SI, NaN for what the plan leaves open."""
        variance = np.diag(self.covariance)
        return np.where(variance > 0.0, np.sqrt(variance), np.nan)


def predict(experiment: Experiment, way: Way) -> Prediction:
    """First-order covariance at the nominal model, the noise as stated."""
    points = experiment.model.predict(experiment.nominal, experiment.poses)
    observation, start = experiment.observe(way, points)
    choice = choose_directions(observation, start)
    span = observation.span()[:, choice.kept]
    return Prediction(way, span, observation.covariance(start, span))


def accuracy_at(
    experiment: Experiment, covariance: Array, targets: Poses, weights: Array
) -> tuple[float, float]:
    """Expected position error [m] at targets, RMS and worst; infinite where a parameter is open."""
    if (np.diag(covariance) == 0.0).any():
        return np.inf, np.inf
    return accuracy(experiment.model, experiment.nominal, covariance, targets, weights)
