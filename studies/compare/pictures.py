"""The figures of a comparison."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.model.covariance import correlation
from calib.threads import one_blas_thread
from studies.compare.anatomy import by_markers, by_poses, influence_by_effect
from studies.compare.compare import Comparison, PlanStudy, Verdict
from studies.plots import accuracy, deviations, ellipses, information
from studies.plots.style import Picture

_PAIRS = 6  # error ellipses: the parameters most entangled


@one_blas_thread
def pictures(result: Comparison) -> list[Picture]:
    """Every figure, plan by plan; file names begin with the plan's where there are several."""
    found = [_plans(result)] if len(result.plans) > 1 else []
    for study in result.plans:
        own = list(_of_plan(result, study))
        if len(result.plans) > 1:
            start = re.sub(r"[^\w.-]+", "_", study.name.removesuffix(".csv"))
            own = [
                replace(p, name=f"{start}_{p.name}", title=f"{study.name}: {p.title}") for p in own
            ]
        found += own
    return found


def _plans(result: Comparison) -> Picture:
    """Standard deviations of approach #2 at every plan side by side."""
    model = result.plans[0].experiment.model
    shared = [s for s in result.plans if _ids(s) == _ids(result.plans[0])]
    return deviations.by_approach(
        _ids(result.plans[0]),
        [p.unit for p in model.parameters],
        {study.name: _shown(study, study.points) for study in shared},
        name="plans",
        title="Standard deviations by plan, approach #2",
    )


def _of_plan(result: Comparison, study: PlanStudy) -> Iterator[Picture]:
    parameters = study.experiment.model.parameters
    names, units = _ids(study), [p.unit for p in parameters]
    predicted = {v.way.key: _shown(study, v) for v in study.verdicts}
    yield deviations.by_approach(names, units, predicted)
    simulated = {
        v.way.key: v.agreement.std / _scales(study)
        for v in study.verdicts
        if v.agreement is not None
    }
    if simulated:
        trials = study.refits.trials
        both = {key: predicted[key] for key in simulated}
        yield deviations.predicted_against_simulated(names, units, both, simulated, trials)
    cov = study.points.prediction.covariance
    yield _ellipses(study, correlation(cov))
    yield ellipses.correlation(names, np.where(np.diag(cov) > 0.0, correlation(cov), np.nan))
    share, groups = influence_by_effect(study.experiment, study.points.prediction, len(study.plan))
    yield information.by_pose(study.plan.names, share, groups)
    what = "task RMS, median of subsets"
    curve = by_poses(result.cell, study.experiment, len(study.plan))
    if len(curve.counts):
        yield accuracy.against_poses(list(curve.counts), _known(curve.rms), what=what)
    curve = by_markers(result.cell, study.plan, study.experiment.length)
    if len(curve.counts) > 1:
        yield accuracy.against_markers(list(curve.counts), _known(curve.rms), what=what)


def _ellipses(study: PlanStudy, R: Array) -> Picture:
    """Ellipses of the robot's parameters that go together most."""
    parameters, scales = study.experiment.model.parameters, _scales(study)
    own = [i for i, p in enumerate(parameters) if p.effect not in ("base", "tool")]
    own = own if len(own) > 1 else list(range(len(parameters)))
    ranked = sorted(
        ((abs(R[a, b]), a, b) for n, a in enumerate(own) for b in own[n + 1 :]), reverse=True
    )
    pairs = [(a, b) for _, a, b in ranked[:_PAIRS]]
    label = dict(enumerate(_ids(study)))
    covariances, samples = {}, {}
    for v in study.verdicts:
        scaled = v.prediction.covariance / np.outer(scales, scales)
        covariances[v.way.key] = np.array([scaled[np.ix_(pair, pair)] for pair in pairs])
        if v.agreement is not None:
            errors = study.refits.of(v.way.key) / scales
            samples[v.way.key] = np.stack([errors[:, list(pair)] for pair in pairs], axis=1)
    return ellipses.ellipses(
        [(label[a], parameters[a].unit, label[b], parameters[b].unit) for a, b in pairs],
        covariances,
        samples,
    )


def _known(rms: dict[str, Array]) -> dict[str, Array]:
    """Medians over the subsets, of ways that can be had at all."""
    medians = {key: np.where(np.isfinite(v[:, 0]), v[:, 0], np.nan) for key, v in rms.items()}
    return {key: v for key, v in medians.items() if np.isfinite(v).any()}


def _shown(study: PlanStudy, verdict: Verdict) -> Array:
    return np.asarray(verdict.prediction.std / _scales(study))


def _ids(study: PlanStudy) -> list[str]:
    return [p.id for p in study.experiment.model.parameters]


def _scales(study: PlanStudy) -> Array:
    return np.array([p.scale for p in study.experiment.model.parameters])
