"""The JSON of ``posecal compare``: the accuracy of plans by approach, and whether to believe it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field

from calib import Cell, Poses
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.model.covariance import accuracy, correlation
from calib.noise import counted
from calib.threads import one_blas_thread
from studies.results.base import MM, Count, Entry, Envelope, Maybe, Number, Result
from studies.results.parts import NamedParameter, ParameterStd

if TYPE_CHECKING:
    from studies.compare.experiment import Prediction, SimulatedExperiment
    from studies.compare.simulate import Refits

BELIEVED = 0.01
"""Probability below which a prediction is refuted."""
_FEWEST, _UNSETTLED = 20, 0.01  # trials that are a proof, share of fits that may fail
_PAIRS = 6  # error ellipses: the parameters most entangled
_NO_PLACE = (
    "the cell does not say where the instrument stands ([instrument] position_mm): its ranges count "
    "from the robot's base"
)


class ComparedParameter(ParameterStd):
    """The same from the scatter of simulated experiments."""

    monte_carlo_std: Maybe


class Agreement(Entry):
    """Simulated over predicted std, farthest from one; the chance of so large a difference."""

    worst_ratio: Maybe
    chi2_p: Maybe


class OverallAgreement(Agreement):
    """Whether the predictions can be believed, over all plans and approaches."""

    believed: bool | None
    says: str

    @classmethod
    def of(cls, plans: Sequence[ComparedPlan], trials: int) -> Self:
        """By Bonferroni's correction of all tests."""
        every = [(f"{own.key} at {plan.plan}", own) for plan in plans for own in plan.approaches]
        judged = [(own.agreement.chi2_p or 0.0, name) for name, own in every if own.agreement]
        ratios = [own.agreement.worst_ratio or 1.0 for _, own in every if own.agreement]
        worst = max(ratios, key=lambda ratio: abs(np.log(ratio)), default=None)
        if trials < _FEWEST or not judged:
            few = f"{trials} simulated experiments are too few to tell: simulate {_FEWEST} or more"
            says = few if trials else "nothing was simulated"
            return cls(worst_ratio=worst, chi2_p=None, believed=None, says=says)
        least, name = min(judged)
        p, says = min(1.0, len(judged) * least), "simulation and prediction agree"
        failed, count = max(((n, own.not_converged) for n, own in every), key=lambda own: own[1])
        if count > _UNSETTLED * trials:
            what = f"{count} of {trials} fits of {failed} did not converge"
            says = f"{what}: the plan hardly determines the model"
        elif p < BELIEVED:
            says = f"refuted for {name}: believe the simulated figures"
        believed = p >= BELIEVED and count <= _UNSETTLED * trials
        return cls(worst_ratio=worst, chi2_p=p, believed=believed, says=says)


class ComparedApproach(Entry):
    """A plan under one approach and weighting; without trials no agreement."""

    approach: Literal["points", "pose"]
    weighting: Literal["full", "normalised", "plain"]
    parameters: tuple[ComparedParameter, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    monte_carlo_task_rms_mm: Maybe
    not_converged: Count
    agreement: Agreement | None

    @property
    def key(self) -> str:
        """``points``, ``pose plain``, .."""
        return "points" if self.approach == "points" else f"pose {self.weighting}"

    @classmethod
    def of(
        cls, cell: Cell, of: SimulatedExperiment, prediction: Prediction, done: Refits | None
    ) -> Self:
        """A prediction, and the fits that test it."""
        from studies.compare.simulate import agreement

        parameters, way = of.model.parameters, prediction.way
        covariance, judged, simulated = prediction.covariance, None, np.inf
        rms, worst = _at_targets(cell, of, covariance)
        if done is not None:
            errors, spare = done.errors[done.settled], int(counted(of.weights).sum())
            cost = done.cost[done.settled] if way.approach == "points" else None
            judged = agreement(errors, covariance, cost, spare - prediction.span.shape[1])
            if judged is not None and np.isfinite(rms):
                simulated, _ = _at_targets(cell, of, errors.T @ errors / len(errors))
        drawn = np.full(len(covariance), np.nan) if judged is None else judged.std
        return cls(
            approach=way.approach,
            weighting=way.weighting,
            parameters=ComparedParameter.known(
                parameters, prediction.std, monte_carlo_std=drawn / [p.scale for p in parameters]
            ),
            task_rms_mm=rms * MM,
            task_worst_mm=worst * MM,
            monte_carlo_task_rms_mm=simulated * MM,
            not_converged=0 if done is None else int((~done.settled).sum()),
            agreement=None
            if judged is None
            else Agreement(worst_ratio=judged.worst_ratio, chi2_p=judged.p),
        )


def _at_targets(cell: Cell, of: SimulatedExperiment, covariance: Array) -> tuple[float, float]:
    """Expected position error [m] at the targets, RMS and worst; infinite where a parameter is open."""
    if (np.diag(covariance) == 0.0).any():
        return np.inf, np.inf
    return accuracy(of.model, of.nominal, covariance, *targets_of(cell))


class Improvement(NamedParameter):
    """Plain approach #1 over approach #2; None where they determine different parameters."""

    factor: Maybe


class CorrelatedPair(Entry):
    """Two parameters that go together, and their covariance by approach, in their units."""

    ids: tuple[str, str]
    covariance: dict[str, tuple[tuple[Number, Number], tuple[Number, Number]]]

    @classmethod
    def each(cls, of: SimulatedExperiment, predictions: Sequence[Prediction]) -> Iterator[Self]:
        """The robot's parameters that go together most, or all where it has but one."""
        every, R = of.model.parameters, correlation(predictions[-1].covariance)
        own = [i for i, p in enumerate(every) if p.effect not in ("base", "tool")]
        own = own if len(own) > 1 else list(range(len(every)))
        pairs = [(abs(R[a, b]), a, b) for n, a in enumerate(own) for b in own[n + 1 :]]
        for _, a, b in sorted(pairs, reverse=True)[:_PAIRS]:
            scales, part = np.array([every[a].scale, every[b].scale]), np.ix_([a, b], [a, b])
            units = np.outer(scales, scales)
            covariance = {p.way.key: (p.covariance[part] / units).tolist() for p in predictions}
            yield cls(ids=(every[a].id, every[b].id), covariance=covariance)


class ComparedPlan(Entry):
    """One plan under every approach, the last of them that of points."""

    plan: str
    poses: Count
    readings: Count
    hidden_markers: Count
    approaches: tuple[ComparedApproach, ...] = Field(min_length=1)
    improvement: tuple[Improvement, ...]
    entangled: tuple[CorrelatedPair, ...]

    @classmethod
    def of(
        cls, cell: Cell, plan: str, poses: int, of: SimulatedExperiment,
        predictions: Sequence[Prediction], done: Mapping[str, Refits],
    ) -> Self:  # fmt: skip
        """A plan, predicted and simulated."""
        plain, points = predictions[0].std, predictions[-1].std
        same = np.array_equal(np.isnan(plain), np.isnan(points))
        factor = plain / points if same else np.full(len(points), np.nan)
        several = len(predictions) > 1
        return cls(
            plan=plan,
            poses=poses,
            readings=len(of.poses),
            hidden_markers=int((~of.seen).sum()),
            approaches=tuple(
                ComparedApproach.of(cell, of, p, done.get(p.way.key)) for p in predictions
            ),
            improvement=Improvement.each(of.model.parameters, factor=factor) if several else (),
            entangled=tuple(CorrelatedPair.each(of, predictions)),
        )

    @property
    def points(self) -> ComparedApproach:
        """Under approach #2, which any markers allow."""
        return self.approaches[-1]

    @property
    def ids(self) -> list[str]:
        """Identifiers of the parameters."""
        return [p.id for p in self.points.parameters]


class CompareResult(Result):
    """Which approach, which weighting, which plan, and whether the figures can be believed."""

    command: Literal["compare"] = "compare"
    plans: tuple[ComparedPlan, ...] = Field(min_length=1)
    targets: str
    task_at: Literal["markers", "tip origin"]
    notes: tuple[str, ...]
    trials: Count
    agreement: OverallAgreement

    @classmethod
    def of(
        cls, cell: Cell, plans: Sequence[ComparedPlan], trials: int, made_from: Envelope
    ) -> Self:
        """All plans, and what their trials say together."""
        tool = any(p.effect == "tool" for p in plans[0].points.parameters)
        unplaced = cell.noise.grows and cell.instrument is None
        return cls(
            **made_from,
            plans=tuple(plans),
            targets=cell.targets_in_words,
            task_at="markers" if tool else "tip origin",
            notes=(_NO_PLACE,) if unplaced else (),
            trials=trials,
            agreement=OverallAgreement.of(plans, trials),
        )


@one_blas_thread
def compared(
    cell: Cell,
    plans: Mapping[str, Poses],
    trials: int = 0,
    *,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> list[ComparedPlan]:
    """Predict what each approach will know of the cell's model at each plan, and simulate it.

    Nothing is simulated before all is predicted. Raises UnknownEffect, EffectCannotAct, CalibError.
    """
    from studies.compare.experiment import experiment_of, predict
    from studies.compare.simulate import refits

    experiments = [experiment_of(cell, p, seed=seed, name=name) for name, p in plans.items()]
    predicted = [[predict(own, way) for way in own.ways] for own in experiments]
    found = []
    for k, (name, plan) in enumerate(plans.items()):
        done = refits(
            experiments[k],
            predicted[k],
            trials,
            seed=(seed, k),
            executor=executor,
            progress=progress,
        )
        found.append(ComparedPlan.of(cell, name, len(plan), experiments[k], predicted[k], done))
    return found
