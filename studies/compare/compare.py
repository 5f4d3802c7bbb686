"""Which approach, which weighting, which plan; and whether the prediction can be believed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Literal, get_args

import numpy as np

from calib.api import as_vector
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.errors import CalibError, InputError
from calib.model.build import build
from calib.noise import counted
from calib.poses import Poses
from calib.threads import one_blas_thread
from studies.compare.agreement import (
    BELIEVED,
    FEWEST,
    Agreement,
    Derivatives,
    agreement,
    derivatives,
    two_sided,
)
from studies.compare.experiment import (
    PLAIN,
    POINTS,
    SimulatedExperiment,
    Way,
    experiment_of,
    refuse_unseen,
)
from studies.compare.in_mujoco import points_in_mujoco
from studies.compare.montecarlo import MOST, Refits, refits, without_noise
from studies.compare.prediction import Prediction, accuracy_at, predict
from studies.compare.stated_noise import StatedNoise

Truth = Literal["model", "mujoco"]
"""Where simulated readings come from: the model that is fitted, or an arm in MuJoCo."""
_NOT_INSTALLED = "MuJoCo is not installed (pip install 'posecal[sim]')"


Reason = Literal["derivative", "chance", "weights", "arm", "truth", "noise", "unknown"]

_RARE = 1e-4  # chance that is no explanation any more
_TRIALS = (100, 1000)  # at little noise: as many as refuted the prediction, within these
_QUIET = 10.0
_ELSEWHERE = 0.01  # standard deviations, RMS: what readings without noise may be off by


@dataclass(frozen=True, eq=False)
class Verdict:
    """One way at one plan.

    task_rms, task_worst : float, m, predicted position error at the targets, infinite where open
    agreement : Agreement, with the trials; None without
    reason : why simulation refutes the prediction, None where it does not
    unsettled : int, trials whose search did not settle and that count nowhere
    simulated_rms : float, m, task RMS from the scatter of the trials, NaN without
    """

    prediction: Prediction
    task_rms: float
    task_worst: float
    agreement: Agreement | None
    reason: Reason | None
    unsettled: int
    simulated_rms: float

    @property
    def way(self) -> Way:
        """Approach and weighting."""
        return self.prediction.way


@dataclass(frozen=True, eq=False)
class PlanStudy:
    """One plan under every way.

    slopes : Derivatives, whether predictions rest on derivatives of the model
    """

    name: str
    plan: Poses
    experiment: SimulatedExperiment
    slopes: Derivatives
    verdicts: tuple[Verdict, ...]
    refits: Refits

    def of(self, way: Way) -> Verdict | None:
        """The verdict on a way, None where the markers do not allow it."""
        return next((v for v in self.verdicts if v.way == way), None)

    @property
    def points(self) -> Verdict:
        """The verdict on approach #2, which any markers allow."""
        return next(v for v in self.verdicts if v.way == POINTS)

    @property
    def improvement(self) -> Array | None:
        """Plain approach #1 over approach #2, by parameter, as in Table I of the paper.

        NaN where the two determine different sets: what is known then rests on different guesses.
        """
        plain = self.of(PLAIN)
        if plain is None:
            return None
        one, two = plain.prediction.std, self.points.prediction.std
        same = np.array_equal(np.isnan(one), np.isnan(two))
        return np.asarray(one / two if same else np.full_like(one, np.nan))


@dataclass(frozen=True, eq=False)
class PlanComparison:
    """The result of :func:`compare`.

    asked : int, trials for each plan
    truth : where their readings come from
    why_not : str, what keeps them from MuJoCo's arm where nobody chose; empty where nothing does
    """

    cell: Cell
    plans: tuple[PlanStudy, ...]
    asked: int
    truth: Truth
    why_not: str = ""

    @property
    def trials(self) -> int:
        """Trials done at the plan that has most; fewer at others after an interruption."""
        return max(study.refits.trials for study in self.plans)

    @property
    def agreements(self) -> list[Agreement]:
        """Agreement of prediction and simulation, of every way at every plan."""
        return [v.agreement for s in self.plans for v in s.verdicts if v.agreement is not None]

    @property
    def worst_ratio(self) -> float | None:
        """Simulated over predicted standard deviation, where it is farthest from one."""
        ratios = [found.worst_ratio for found in self.agreements]
        return max(ratios, key=lambda r: abs(np.log(r)), default=None)

    @property
    def p(self) -> float | None:
        """Probability of so large a disagreement by chance, over all ways and plans."""
        found = [own.p for own in self.agreements if own.trials >= FEWEST]
        return min(1.0, len(found) * min(found)) if found else None


@one_blas_thread
def compare(
    cell: Cell,
    plans: Mapping[str, Poses],
    *,
    trials: int = 200,
    values: Mapping[str, float] | None = None,
    truth: Truth | None = None,
    stated: StatedNoise | None = None,
    length: float = 1.0,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> PlanComparison:
    """Predict and simulate what each approach will know of the cell's model at each plan.

    plans : name -> Poses; trials : int, Monte Carlo refits of each plan by each way, 0 for none
    values : name -> value, SI, where predictions and simulations hold; see ``experiment_of``
    truth : where simulated readings come from. The model's own notice no fault in its kinematics or
        torques, which cancels; MuJoCo's do. None for MuJoCo's where it is installed and can have them
    stated : how simulated readings err by the cell's text, see ``experiment_of``
    length : float, m, characteristic length of the plain weighting
    executor : where the trials are computed; figures do not depend on it
    progress : called with the number of trials just done

    An interruption (KeyboardInterrupt) ends the simulation: the trials done are kept, what was not
    simulated is predicted.

    Raises UnknownEffect, EffectCannotAct, CalibError, also for effects that MuJoCo's arm cannot have
    where it is asked for.
    """
    if not plans:
        raise CalibError("no plan to compare")
    if truth is not None and truth not in get_args(Truth):
        raise CalibError(f"truth {truth!r} is unknown; choose {' or '.join(get_args(Truth))}")
    cell = replace(
        cell, prior=None
    )  # what the readings tell by themselves; simulated robots are no type
    targets, weights = targets_of(cell)
    prepared = [
        _prepared(cell, name, plan, values, stated, length, seed) for name, plan in plans.items()
    ]
    why_not = _NOT_INSTALLED if truth is None and find_spec("mujoco") is None else ""
    if truth == "mujoco" or (truth is None and trials and not why_not):
        try:
            prepared = [
                (replace(e, exact=points_in_mujoco(cell, e.model, e.truth, e.poses)), own)
                for e, own in prepared
            ]
        except InputError as error:
            if truth is not None:
                raise
            why_not = error.what
    used: Truth = "model" if prepared[0][0].exact is None else "mujoco"
    studies: list[PlanStudy] = []
    for index, (name, (experiment, predictions)) in enumerate(zip(plans, prepared, strict=True)):
        interrupted = any(study.refits.trials < trials for study in studies)
        done = refits(
            experiment,
            predictions,
            0 if interrupted else trials,
            seed=(seed, index),
            executor=executor,
            progress=progress,
            scratch=MOST,
        )
        at = (experiment.nominal, experiment.truth)
        slopes = derivatives(experiment.model, experiment.poses, *at)
        verdicts = tuple(
            _verdict(experiment, p, done, slopes, targets, weights, seed) for p in predictions
        )
        studies.append(PlanStudy(name, plans[name], experiment, slopes, verdicts, done))
    return PlanComparison(cell, tuple(studies), trials, used, why_not)


def _prepared(
    cell: Cell,
    name: str,
    plan: Poses,
    values: Mapping[str, float] | None,
    stated: StatedNoise | None,
    length: float,
    seed: int,
) -> tuple[SimulatedExperiment, list[Prediction]]:
    """An experiment and its predictions, before anything is simulated."""
    own = None if values is None else as_vector(build(cell, plan).model, values)
    experiment = experiment_of(cell, plan, values=own, stated=stated, length=length, seed=seed)
    refuse_unseen(experiment, name)
    predictions = [predict(experiment, way) for way in experiment.ways]
    # The truth without what some way leaves open: no fit could answer for it.
    known = np.all([np.isfinite(p.std) for p in predictions], axis=0)
    truth = np.where(known, experiment.truth, experiment.nominal)
    return replace(experiment, truth=truth), predictions


def _verdict(
    experiment: SimulatedExperiment,
    prediction: Prediction,
    done: Refits,
    slopes: Derivatives,
    targets: Poses,
    weights: Array,
    seed: int,
) -> Verdict:
    rms, worst = accuracy_at(experiment, prediction.covariance, targets, weights)
    if not done.trials:
        return Verdict(prediction, rms, worst, None, None, 0, np.nan)
    key = prediction.way.key
    errors = done.of(key)
    cost = done.cost[key][done.settled[key]] if prediction.way == POINTS else None
    spare = int(counted(experiment.weights).sum()) - prediction.span.shape[1]
    judged = agreement(errors, prediction.covariance, cost, spare)
    why, simulated = None, np.nan
    if judged is not None and judged.trials >= FEWEST:
        why = reason(experiment, prediction, errors, judged, seed, slopes.wrong)
    if judged is not None and np.isfinite(rms):
        simulated, _ = accuracy_at(experiment, errors.T @ errors / len(errors), targets, weights)
    return Verdict(prediction, rms, worst, judged, why, done.trials - len(errors), simulated)


# -- why simulation refutes a prediction, which is tried out -------------------------------------


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
    ended, _ = without_noise(experiment, prediction)
    off = (ended - experiment.truth) / prediction.std
    return not float(np.sqrt(np.nanmean(off**2))) < _ELSEWHERE


def _agrees(errors: Array, covariance: Array) -> bool:
    found = agreement(errors, covariance)
    return found is not None and found.p >= BELIEVED
