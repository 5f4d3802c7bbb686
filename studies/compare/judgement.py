"""Whether to believe a prediction; if not, why, which is tried out, and by how much."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from calib.arrays import Array
from calib.noise import counted
from calib.solver import levenberg_marquardt
from studies.compare.agreement import BELIEVED, FEWEST, Agreement, agreement, two_sided
from studies.compare.experiment import SimulatedExperiment
from studies.compare.montecarlo import refits, surprising
from studies.compare.prediction import Prediction, predict

if TYPE_CHECKING:
    from studies.compare.compare import PlanComparison, PlanStudy, Verdict

Reason = Literal["derivative", "chance", "weights", "arm", "truth", "noise", "unknown"]

_RARE = 1e-4  # chance that is no explanation any more
_TRIALS = (100, 1000)  # at little noise: as many as refuted the prediction, within these
_QUIET = 10.0
_ELSEWHERE = 0.01  # standard deviations, RMS: what readings without noise may be off by

SAYS: dict[Reason, str] = {
    "derivative": "a derivative that the prediction rests on is wrong, and nonlinearity explains "
    "nothing here",
    "chance": "this may be chance: repeat with another --seed or more trials",
    "weights": "the fits are weighted by other noise than the cell states, a fault of the program: its "
    "standard deviations are wrong",
    "arm": "even without noise the fits end beside the truth: the arm that is fitted is not the one "
    "that was measured, so its kinematics, torques or masses are wrong",
    "truth": "predicted at the simulated robot it agrees: the robot's errors change what the plan "
    "tells, so predict at identified values (--values)",
    "noise": "at a tenth of the noise it agrees: the fits are not linear in noise of this size; more "
    "poses, spread wider, would help",
    "unknown": "neither the robot's errors nor the size of the noise explains it: believe the "
    "simulated figures",
}


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


UNSETTLED = 0.01
"""Share of fits that may fail to settle before the rest says too little."""


def believed(result: PlanComparison) -> bool | None:
    """Whether prediction and simulation agree; None where too little was simulated to tell."""
    if any(study.slopes.wrong for study in result.plans):
        return False
    if result.trials < FEWEST:
        return None
    verdicts = [v for study in result.plans for v in study.verdicts]
    lost = max(v.unsettled for v in verdicts) > UNSETTLED * result.trials
    agrees = result.p is not None and result.p >= BELIEVED
    return agrees and not lost and _astray(result) is None


def says(result: PlanComparison) -> str:
    """Whether to believe the prediction, and if not, why and by how much."""
    for study in result.plans:
        if study.slopes.wrong:
            return (
                f"refuted at {study.name}: the derivative by {study.slopes.parameter} is "
                f"{100.0 * study.slopes.off:.3g} % off the model's own slope, a fault of the program "
                "or of an added effect; what is predicted rests on it"
            )
    if not result.trials:
        return "nothing was simulated"
    if result.trials < FEWEST:
        return (
            f"{result.trials} simulated experiments are too few to tell: simulate {FEWEST} or more"
        )
    pairs = [(study, v) for study in result.plans for v in study.verdicts]
    study, verdict = max(pairs, key=lambda pair: pair[1].unsettled)
    if verdict.unsettled > UNSETTLED * result.trials:
        return (
            f"{verdict.unsettled} of {study.refits.trials} fits of {verdict.way.key} at "
            f"{study.name} did not converge: the plan hardly determines the model"
        )
    if result.p is not None and result.p >= BELIEVED:
        return _astray(result) or "simulation and prediction agree"
    study, verdict = min(
        (pair for pair in pairs if pair[1].agreement is not None),
        key=lambda pair: pair[1].agreement.p if pair[1].agreement is not None else 1.0,
    )
    why = SAYS[verdict.reason or "chance"]
    return f"refuted at {study.name}, {verdict.way.key}: {_failed(study, verdict)}; {why}"


def _astray(result: PlanComparison) -> str | None:
    """What trials that were identified from scratch did otherwise than their refits, if too many."""
    for study in result.plans:
        for key, done in study.refits.scratch.items():
            elsewhere, noisy, left = surprising(done)
            if elsewhere:
                count = sum(not own.same for own in done)
                return (
                    f"refuted at {study.name}, {key}: {count} of {len(done)} fits from raw data end "
                    "elsewhere than fits that start at the true robot: start values or outliers "
                    "mislead them"
                )
            if left:
                return (
                    f"refuted at {study.name}, {key}: the residuals of {len(done)} fits from raw "
                    "data do not agree with their degrees of freedom: the program counts these wrongly"
                )
            if noisy:
                count = sum(own.noise != "cell" for own in done)
                return (
                    f"refuted at {study.name}, {key}: {count} of {len(done)} fits from raw data "
                    "estimate another noise than the cell states"
                )
    return None


def _failed(study: PlanStudy, verdict: Verdict) -> str:
    """Which test failed most, and by how much."""
    found = verdict.agreement
    if found is None:
        return "no fit converged"
    worst = min(found.tests, key=lambda name: found.tests[name])
    if worst == "bias":
        return f"the mean error is {found.shift:.3g} standard deviations in every direction"
    if worst == "left":
        return f"the residuals differ from the noise by {100.0 * (found.left**0.5 - 1.0):+.3g} %"
    if worst == "scatter":
        return f"all directions together scatter {100.0 * (found.total**0.5 - 1.0):+.3g} %"
    ratio = np.where(np.isfinite(found.ratio), found.ratio, 1.0)
    where = int(np.abs(np.log(ratio)).argmax())
    name = study.experiment.model.parameters[where].id
    return f"{name} scatters {100.0 * (ratio[where] - 1.0):+.3g} %"
