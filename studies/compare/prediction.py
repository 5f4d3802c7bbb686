"""Predicted accuracy of a plan, of each method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.identification.fit import choose_directions
from calib.model.covariance import accuracy
from calib.poses import Poses
from studies.compare.experiment import FULL, POINTS, SimulatedExperiment, Way


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


def predict(experiment: SimulatedExperiment, way: Way) -> Prediction:
    """First-order covariance at the nominal model, the noise as stated.

    What the plan determines is judged by the points, whatever the way: nothing can be known from poses
    computed from them that they do not tell themselves.
    """
    points = experiment.model.predict(experiment.nominal, experiment.poses)
    observation, start = experiment.observe(POINTS, points)
    kept = choose_directions(observation, start).kept
    kept = kept[np.abs(observation.flat(start)[1][:, kept]).any(axis=0)]
    if way.approach == "points":
        span = np.eye(len(start))[:, kept]
        return Prediction(way, span, observation.covariance(start, span))
    observation, start = experiment.observe(way, points)
    span, lost = observation.span(), np.setdiff1d(np.arange(len(start)), kept)
    span = span[:, ~np.abs(span[lost]).any(axis=0)]  # that moves nothing but what is kept
    known, _ = experiment.observe(FULL, points)
    span = span[:, choose_directions(known, start, span).kept]
    return Prediction(way, span, observation.covariance(start, span))


def accuracy_at(
    experiment: SimulatedExperiment, covariance: Array, targets: Poses, weights: Array
) -> tuple[float, float]:
    """Expected position error [m] at targets, RMS and worst; infinite where a parameter is open."""
    if (np.diag(covariance) == 0.0).any():
        return np.inf, np.inf
    return accuracy(experiment.model, experiment.nominal, covariance, targets, weights)
