"""What a selection of causes found, and the search that selects anew while noise and outliers change.

Causes are selected about a fit to first order (:mod:`calib.diagnosis.selection`); with them the model
is fitted anew, and they are selected again where the weights of its poses follow. What the search ends
with is fitted in full by whoever asked for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.lineup import FitView, Lineup, lineup
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.screen import Field, Score, ScoreRequest, scored
from calib.diagnosis.selection import selection
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tuned import Tuned
from calib.errors import Unsolvable
from calib.identification.noise_level import replicate_factor
from calib.identification.noise_scales import noise_scales

_MOST_FITS = 2  # of a selection, while the weights of poses follow from it
_SETTLED = 0.1  # change of a weight that is not worth another
_MOST_PASSES = 2  # selections, while outliers are judged anew


@dataclass(frozen=True, eq=False)
class JudgedCandidate:
    """A candidate that entered the model, judged with all others in place.

    score : Score, its own; rivals : tuple of (Candidate, gain), all in its place, the best first
    fall : float, by which it lowers the sum of squares, in variances of the instrument
    """

    candidate: Candidate
    score: Score
    fall: float
    rivals: tuple[tuple[Candidate, float], ...]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a selection ended.

    before : Fit, without all that entered; active : tuple of Candidate, what entered
    view : FitView, of all suspects from the fit with that
    lineup : Lineup, the same with all their tunings
    """

    before: Fit
    active: tuple[Candidate, ...]
    view: FitView
    lineup: Lineup

    @property
    def fit(self) -> Fit:
        """With all that entered."""
        return self.view.fit

    @property
    def suspects(self) -> tuple[Candidate, ...]:
        """All candidates, those with a tuning at the best one."""
        return self.view.suspects

    @cached_property
    def entries(self) -> tuple[JudgedCandidate, ...]:
        """Every selected candidate with the candidates that could take its place."""
        return tuple(_entry(self.view, c, self.active) for c in self.active)


def selected(
    stage: Stage, lineup: Lineup, active: Sequence[Candidate] = (), before: Fit | None = None
) -> Outcome:
    """Select candidates about fits whose weights follow from what is selected.

    stage : Stage, to first order; active : candidates to begin with
    before : Fit, without any, where an earlier selection of the same stage has it
    """
    before = stage.fit(()) if before is None else before
    found = _numbered(active)
    fit = stage.fit([c.effect for c in found], before) if found else before
    for _ in range(_MOST_FITS):
        bare = fit.without([c.effect for c in found]) if found else fit
        found = _numbered(selection(RegressionProblem.of(stage, lineup, bare), found))
        last, fit = fit, stage.fit([c.effect for c in found], fit) if found else before
        if np.allclose(fit.weight, last.weight, atol=_SETTLED):
            break
    return Outcome(before, found, lineup.seen_from(fit, found), lineup)


def _numbered(active: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The same with causes of one kind at one place numbered from one."""
    found: list[Candidate] = []
    for c in active:
        line = 1 + sum(other.is_like(c) for other in found)
        tuned = isinstance(c.effect, Tuned) and c.line != line
        found.append(replace(c, line=line) if tuned else c)
    return tuple(found)


def restricted_to(stage: Stage, outcome: Outcome, rest: Sequence[Candidate]) -> Outcome:
    """The outcome with a part of its members alone, no candidate tried again."""
    fit = stage.fit([c.effect for c in rest], outcome.fit)
    return replace(outcome, active=tuple(rest), view=outcome.lineup.seen_from(fit, rest))


def _entry(view: FitView, member: Candidate, active: Sequence[Candidate]) -> JudgedCandidate:
    rest = [c for c in active if c is not member]
    stiff = isinstance(member.effect, ElasticEffect) and not anything_elastic((), view)
    suspects = [
        c
        for c in view.suspects
        if c is member
        or (
            not c.is_like(member)
            and c.echo in ("", member.key)
            and not (stiff and isinstance(c.effect, LoadEffect))
        )
    ]
    taken = with_curves(member, active)
    scores = linear_scores(view.without(*taken), view, suspects)
    gains = [(c, scores[c.key].gain) for c in suspects if c not in rest]
    gains.sort(key=lambda pair: -pair[1])
    own = scores[member.key]
    alone = own
    if view.fit.mixing is not None:
        bare = view.by_instrument
        alone = linear_scores(bare.without(*taken), bare, [member])[member.key]
    return JudgedCandidate(member, own, alone.fall, tuple(gains))


def with_curves(member: Candidate, active: Sequence[Candidate]) -> list[Candidate]:
    """A member and the curves that can do the same, which must not take the place of a named cause."""
    return [member, *(c for c in active if c.covers(member))]


def anything_elastic(active: Sequence[Candidate], view: FitView) -> bool:
    """Whether the user's model, or what is in, holds something elastic.

    A load moves nothing else, though to first order about an arm that yields its columns stay.
    """
    asked = {id(c.effect) for c in view.suspects}
    effects = [e for e in view.fit.model.effects if id(e) not in asked]
    return any(isinstance(e, ElasticEffect) for e in (*effects, *(c.effect for c in active)))


def linear_scores(beside: Field, view: FitView, suspects: Sequence[Candidate]) -> dict[str, Score]:
    """Score of each suspect, those with a tuning counted, at the variances of the fit."""
    asked = [ScoreRequest(view.where[c.key], c.spread, c.limits, c.eliminate) for c in suspects]
    found = scored(beside, asked)
    return {c.key: own.counted(c.choices) for c, own in zip(suspects, found, strict=True)}


def plausible(stage: Stage, outcome: Outcome) -> Outcome:
    """The outcome without what is far out, one fit after the other."""
    while True:
        rest = [c for c in outcome.active if not (c.named and far_out(outcome.fit, c))]
        if len(rest) == len(outcome.active):
            return outcome
        outcome = restricted_to(stage, outcome, rest)


def far_out(fit: Fit, candidate: Candidate) -> str:
    """What of a cause is larger than such errors usually are, empty where nothing is."""
    amounts, values = candidate.amounts, fit.values[fit.model.amounts(candidate.effect)]
    worst = int(np.argmax(np.abs(values) / candidate.limits))
    p, limit = amounts[worst], float(candidate.limits[worst])
    if abs(values[worst]) <= limit:
        return ""
    return (
        f"its {p.name} of {values[worst] / p.scale:.3g} {p.unit} is far out: beyond "
        f"{limit / p.scale:.3g} {p.unit} such an error is seldom met"
    )


# -- the search in full: about the exact fit, and anew while noise and outliers are judged anew ----


@dataclass(frozen=True, eq=False)
class Search:
    """Where the search ended.

    stage : Stage, what was fitted; linear : the same to first order about its last fit
    factor : float, actual over stated noise by readings that were repeated
    statistic : ndarray, shape (m,), of each pose under that fit, an outlier's above ``limit``
    """

    stage: Stage
    linear: Stage
    outcome: Outcome
    factor: float
    statistic: Array
    limit: float


def search(stage: Stage, suspects: Sequence[Candidate]) -> Search:
    """Select effects that explain the residual, with noise and outliers judged anew.

    stage : Stage, weighed by the noise as stated; what it drops stays out
    """
    stated, data, waiting = stage.weights, stage.data, stage.dropped
    factor = replicate_factor(data, stated)
    stage = replace(stage, weights=stated / factor)
    linear = stage.about(stage.fit(()), [c.effect for c in suspects])
    asked = lineup(linear, suspects)
    outcome = selected(linear, asked)
    readout = stage.model.readout
    scales = _scales_of(stage, outcome.fit, factor)
    if scales:
        stated = readout.rescaled(stated, scales)
        factor = replicate_factor(data, stated)
        model = replace(stage.model, noise_scales=scales)
        stage = replace(stage, model=model, weights=stated / factor)
        known = replace(linear.model, noise_scales=scales)
        linear = replace(linear, weights=stage.weights, model=known)
        outcome = selected(linear, asked)
    statistic, limit = np.zeros(len(data)), np.inf
    for _ in range(_MOST_PASSES):
        try:
            fit = stage.exact(outcome.fit)
        except Unsolvable:  # to first order an arm may be so soft that it does not stand
            outcome = plausible(linear, outcome)
            fit = stage.exact(outcome.fit)
        out, statistic, limit = stage.outliers(fit)
        out |= waiting
        if not stage.robust and np.array_equal(out, stage.dropped):
            break
        stage = replace(stage, dropped=out, robust=False)
        active = [c.as_tuned(float(fit.values[fit.positions(c.effect)[0]])) for c in outcome.active]
        grids = asked.grids
        del linear, asked, outcome  # the largest arrays of all
        linear = stage.about(fit, [c.effect for c in suspects])
        asked = lineup(linear, suspects, grids)
        outcome = selected(linear, asked, active)
    return Search(stage, linear, outcome, factor, statistic, limit)


def _scales_of(stage: Stage, fit: Fit, factor: float) -> Mapping[str, float]:
    """Actual over stated noise of several instruments, where that is another for some of them.

    factor : actual over stated noise by which the stage weighs all of them
    """
    found = noise_scales(fit.observation, stage.scatter, fit.r, fit.J @ fit.span)
    return found and {i.name: factor * found.get(i.name, 1.0) for i in stage.model.instruments}
