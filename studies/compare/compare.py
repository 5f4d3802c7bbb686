"""Which approach, which weighting, which plan; and whether the prediction can be believed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from calib.api import as_vector
from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.errors import CalibError
from calib.model.build import build
from calib.noise import counted
from calib.poses import Poses
from calib.threads import one_blas_thread
from studies.compare.agreement import FEWEST, Agreement, agreement
from studies.compare.experiment import (
    PLAIN,
    POINTS,
    SimulatedExperiment,
    Way,
    experiment_of,
    refuse_unseen,
)
from studies.compare.montecarlo import Refits, refits
from studies.compare.prediction import Prediction, accuracy_at, predict


@dataclass(frozen=True, eq=False)
class Verdict:
    """One way at one plan.

    task_rms, task_worst : float, m, predicted position error at the targets, infinite where open
    agreement : Agreement, with the trials; None without
    unsettled : int, trials whose search did not settle and that count nowhere
    simulated_rms : float, m, task RMS from the scatter of the trials, NaN without
    """

    prediction: Prediction
    task_rms: float
    task_worst: float
    agreement: Agreement | None
    unsettled: int
    simulated_rms: float

    @property
    def way(self) -> Way:
        """Approach and weighting."""
        return self.prediction.way


@dataclass(frozen=True, eq=False)
class PlanStudy:
    """One plan under every way."""

    name: str
    plan: Poses
    experiment: SimulatedExperiment
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

    trials : int, done at each plan
    """

    cell: Cell
    plans: tuple[PlanStudy, ...]
    trials: int

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
    length: float = 1.0,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> PlanComparison:
    """Predict and simulate what each approach will know of the cell's model at each plan.

    plans : name -> Poses; trials : int, Monte Carlo refits of each plan by each way, 0 for none
    values : name -> value, SI, where predictions and simulations hold; see ``experiment_of``
    length : float, m, characteristic length of the plain weighting
    executor : where the trials are computed; figures do not depend on it
    progress : called with the number of trials just done

    Raises UnknownEffect, EffectCannotAct, CalibError.
    """
    if not plans:
        raise CalibError("no plan to compare")
    targets, weights = targets_of(cell)
    prepared = [_prepared(cell, name, plan, values, length, seed) for name, plan in plans.items()]
    studies: list[PlanStudy] = []
    for index, (name, (experiment, predictions)) in enumerate(zip(plans, prepared, strict=True)):
        done = refits(
            experiment,
            predictions,
            trials,
            seed=(seed, index),
            executor=executor,
            progress=progress,
        )
        verdicts = tuple(_verdict(experiment, p, done, targets, weights) for p in predictions)
        studies.append(PlanStudy(name, plans[name], experiment, verdicts, done))
    return PlanComparison(cell, tuple(studies), trials)


def _prepared(
    cell: Cell,
    name: str,
    plan: Poses,
    values: Mapping[str, float] | None,
    length: float,
    seed: int,
) -> tuple[SimulatedExperiment, list[Prediction]]:
    """An experiment and its predictions, before anything is simulated."""
    own = None if values is None else as_vector(build(cell, plan).model, values)
    experiment = experiment_of(cell, plan, values=own, length=length, seed=seed)
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
    targets: Poses,
    weights: Array,
) -> Verdict:
    rms, worst = accuracy_at(experiment, prediction.covariance, targets, weights)
    if not done.trials:
        return Verdict(prediction, rms, worst, None, 0, np.nan)
    key = prediction.way.key
    errors = done.of(key)
    cost = done.cost[key][done.settled[key]] if prediction.way == POINTS else None
    spare = int(counted(experiment.weights).sum()) - prediction.span.shape[1]
    judged = agreement(errors, prediction.covariance, cost, spare)
    simulated = np.nan
    if judged is not None and np.isfinite(rms):
        simulated, _ = accuracy_at(experiment, errors.T @ errors / len(errors), targets, weights)
    return Verdict(prediction, rms, worst, judged, done.trials - len(errors), simulated)
