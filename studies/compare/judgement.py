"""Why simulation refutes a prediction, which is tried out."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from calib.arrays import Array
from calib.noise import counted
from calib.solver import levenberg_marquardt
from studies.compare.agreement import BELIEVED, Agreement, agreement, two_sided
from studies.compare.experiment import SimulatedExperiment
from studies.compare.montecarlo import refits
from studies.compare.prediction import Prediction, predict

Reason = Literal["derivative", "chance", "weights", "arm", "truth", "noise", "unknown"]

_RARE = 1e-4  # chance that is no explanation any more
_TRIALS = (100, 1000)  # at little noise: as many as refuted the prediction, within these
_QUIET = 10.0
_ELSEWHERE = 0.01  # standard deviations, RMS: what readings without noise may be off by


def reason(
    experiment: SimulatedExperiment,
    prediction: Prediction,
    errors: Array,
    judged: Agreement,
    seed: int,
    wrong_derivative: bool = False,
) -> Reason | None:
    """The first explanation that holds, None where there is nothing to explain.

    errors : ndarray, shape (trials, p), SI, that the prediction failed
    wrong_derivative : whether a column of the Jacobian is no derivative
    """
    if judged.p >= BELIEVED:
        return None
    if wrong_derivative:
        return "derivative"
    if judged.p > _RARE:
        return "chance"
    if _weighted_wrongly(experiment, seed):
        return "weights"
    if experiment.exact is not None and _ends_elsewhere(experiment, prediction):
        return "arm"
    there = predict(replace(experiment, nominal=experiment.truth), prediction.way)
    if _agrees(errors, there.covariance):
        return "truth"
    # As much power as refuted the prediction: with less, a wrong covariance would agree again.
    quiet = experiment.quieter(_QUIET)
    done = refits(quiet, [prediction], int(np.clip(judged.trials, *_TRIALS)), seed=(seed, 1))
    if _agrees(done.of(prediction.way.key), there.covariance / _QUIET**2):
        return "noise"
    return "unknown"


def _weighted_wrongly(experiment: SimulatedExperiment, seed: int) -> bool:
    """Whether noise as the cell states it is not of unit variance under the weights of the fits."""
    rng = np.random.default_rng((seed, 2))
    white = experiment.weights @ experiment.noise(_TRIALS[0], rng)[..., None]
    numbers = _TRIALS[0] * int(counted(experiment.weights).sum())
    return two_sided(float((white**2).sum()), numbers) < _RARE


def _ends_elsewhere(experiment: SimulatedExperiment, prediction: Prediction) -> bool:
    """Whether readings without noise lead anywhere but to the truth."""
    observation, start = experiment.observe(prediction.way, experiment.readings())
    best = levenberg_marquardt(observation.flat, start, prediction.span)
    off = (best.values - experiment.truth) / prediction.std
    return not float(np.sqrt(np.nanmean(off**2))) < _ELSEWHERE


def _agrees(errors: Array, covariance: Array) -> bool:
    found = agreement(errors, covariance)
    return found is not None and found.p >= BELIEVED
