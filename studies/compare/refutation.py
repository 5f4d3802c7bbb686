"""Why simulation refutes a prediction: tried out, not guessed."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from calib.se3 import Array
from studies.compare.agreement import BELIEVED, Agreement, agreement
from studies.compare.experiment import Experiment
from studies.compare.montecarlo import refits
from studies.compare.prediction import Prediction, predict

Reason = Literal["chance", "truth", "noise", "unknown"]

_RARE = 1e-4  # chance that is no explanation any more
_TRIALS = 100
_QUIET = 10.0

SAYS: dict[Reason, str] = {
    "chance": "this may be chance: repeat with another --seed or more trials",
    "truth": "predicted at the simulated robot it agrees: the robot's errors change what the plan "
    "tells, so predict at identified values (--values)",
    "noise": "at a tenth of the noise it agrees: the fits are not linear in noise of this size; more "
    "poses, spread wider, would help",
    "unknown": "neither the robot's errors nor the size of the noise explains it: believe the "
    "simulated figures",
}


def reason(
    experiment: Experiment, prediction: Prediction, errors: Array, judged: Agreement, seed: int
) -> Reason | None:
    """The first explanation that holds, None where there is nothing to explain.

    errors : ndarray, shape (trials, p), SI, that the prediction failed
    """
    if judged.p >= BELIEVED:
        return None
    if judged.p > _RARE:
        return "chance"
    there = predict(replace(experiment, nominal=experiment.truth), prediction.way)
    if _agrees(errors, there.covariance):
        return "truth"
    quiet = replace(experiment, weights=_QUIET * experiment.weights)
    done = refits(quiet, [prediction], _TRIALS, seed=(seed, 1))
    if _agrees(done.of(prediction.way.key), there.covariance / _QUIET**2):
        return "noise"
    return "unknown"


def _agrees(errors: Array, covariance: Array) -> bool:
    found = agreement(errors, covariance)
    return found is not None and found.p >= BELIEVED
