"""What is named: its size and share, and how sure it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.diagnosis.diagnosis import Cause
from calib.diagnosis.finding import Finding
from calib.diagnosis.located import share_of
from calib.diagnosis.named import Named
from calib.diagnosis.probability import Evidence
from calib.diagnosis.refused import Refused, far_out, is_weak
from calib.diagnosis.shape import form_matters, shape_doubt
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.standing import standing_of
from calib.identification.tuning import profiled
from calib.model.covariance import determined
from calib.poses import Poses


def causes_of(
    finding: Finding, asked: int, targets: Poses, again: Mapping[str, float]
) -> Iterator[Cause]:
    """The causes of a finding that are plainly there.

    asked : int, over how many its p counts; targets : where accuracy counts
    again : share of the folds without which each entry is chosen again
    """
    if not finding.named:
        return
    stage, after = finding.search.stage, finding.after
    std = _deviations(stage, after, finding.scale)
    for named in finding.named:
        if is_weak(after, named.candidate):
            continue
        effect, entry = named.candidate.effect, named.entry
        own = after.positions(effect)
        doubt = shape_doubt(stage, after, effect, len(finding.named))
        company = doubt.stands or _company(finding, named)
        comes_again = again[entry.candidate.key]
        evidence = Evidence(
            f"{effect.kind}:{effect.where}", doubt.p, named.curve_ratio, comes_again, company
        )
        there = stage.data.poses if effect.uses else targets  # targets have neither time nor moves
        yield Cause(
            named=named,
            doubt=doubt,
            values=after.values[own],
            std=std[own],
            p=min(1.0, entry.score.p * asked),
            share=share_of(finding.outcome, after, entry, finding.scale),
            evidence=evidence,
            standing=standing_of(
                named,
                evidence.probability,
                doubt,
                form_matters(after, effect, there, finding.floor),
            ),
            far_out=far_out(after, named.candidate),
        )


def weak_of(finding: Finding) -> Iterator[Refused]:
    """What is fitted and not named, for it is hardly more than its own uncertainty."""
    for named in finding.named:
        if is_weak(finding.after, named.candidate):
            yield Refused.of(named.candidate, "weak")


def _company(finding: Finding, named: Named) -> bool:
    """Whether anything else is found at the place of a cause."""
    where, own = named.candidate.where, named.entry.candidate
    return any(c.where == where and c is not own for c in finding.outcome.active)


def _deviations(stage: Stage, after: Fit, scale: float) -> Array:
    """Standard deviations of all values, shape (p,), NaN where the data do not determine the value.

    Of tunings those of the profile likelihood, where that is no parabola.
    """
    std = np.where(determined(after.span), scale * np.sqrt(np.diag(after.covariance)), np.nan)
    observation = stage.observation(after.model, after.weight)
    observation = replace(observation, scatter=stage.scatter.at(after.variances))
    profile = profiled(observation, after.values, after.span, std, scale)
    return np.where(np.isfinite(profile), profile, std)
