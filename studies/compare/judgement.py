"""Whether to believe a comparison's prediction, and if not, why and by how much."""

from __future__ import annotations

import numpy as np

from studies.compare.agreement import BELIEVED, FEWEST
from studies.compare.compare import Comparison, PlanStudy, Verdict
from studies.compare.refutation import SAYS
from studies.compare.scratch import surprising

UNSETTLED = 0.01
"""Share of fits that may fail to settle before the rest says too little."""


def believed(result: Comparison) -> bool | None:
    """Whether prediction and simulation agree; None where too little was simulated to tell."""
    if any(study.slopes.wrong for study in result.plans):
        return False
    if result.trials < FEWEST:
        return None
    verdicts = [v for study in result.plans for v in study.verdicts]
    lost = max(v.unsettled for v in verdicts) > UNSETTLED * result.trials
    agrees = result.p is not None and result.p >= BELIEVED
    return agrees and not lost and _astray(result) is None


def says(result: Comparison) -> str:
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


def _astray(result: Comparison) -> str | None:
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
