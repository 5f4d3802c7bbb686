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
from calib.diagnosis.columns import CandidateSet, candidate_set
from calib.diagnosis.judged import JudgedCandidate, judged
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.selection import selection, start
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.state import SelectionState
from calib.errors import Unsolvable
from calib.identification.noise_level import replicate_factor
from calib.identification.noise_scales import noise_scales

_MOST_FITS = 2  # of a selection, while the weights of poses follow from it
_SETTLED = 0.1  # change of a weight that is not worth another
_MOST_PASSES = 2  # selections, while outliers are judged anew


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a selection ended.

    before : Fit, without all that entered; fit : Fit, with it; state : SelectionState
    """

    before: Fit
    fit: Fit
    state: SelectionState

    @property
    def active(self) -> tuple[Candidate, ...]:
        """What entered."""
        return self.state.active

    @cached_property
    def judged(self) -> SelectionState:
        """The state with what could take the place of its members, at the best tunings."""
        return self.state.scanned(echoes=True)

    @property
    def suspects(self) -> tuple[Candidate, ...]:
        """All candidates, those with a tuning at the best one."""
        return tuple(c.candidate for c in self.judged.candidates)

    @cached_property
    def entries(self) -> tuple[JudgedCandidate, ...]:
        """Every selected candidate with the candidates that could take its place."""
        return tuple(judged(self.judged))


def selected(
    stage: Stage,
    candidates: CandidateSet,
    active: Sequence[Candidate] = (),
    last: Outcome | None = None,
    thorough: bool = True,
) -> Outcome:
    """Select candidates about fits whose weights follow from what is selected.

    stage : Stage, to first order; active : candidates to begin with
    last : Outcome, of an earlier selection of the same stage
    thorough : whether all moves are tried, and weights followed: what comes first need not be final
    """
    if last is None:
        before, problem = _without_any(stage, candidates)
        fit = before
    else:
        before, problem, fit = last.before, last.state.problem, last.fit
    for _ in range(_MOST_FITS if thorough else 1):
        if not _weighs_alike(problem.fit, fit):
            problem = RegressionProblem.of(stage, candidates, stage.weighted((), fit.weight))
        state = selection(replace(problem, candidates=candidates), active, thorough)
        active, fit = state.active, fitted(stage, state, fit)
        if _weighs_alike(problem.fit, fit):
            break
    return Outcome(before, fit, state)


def _without_any(stage: Stage, candidates: CandidateSet) -> tuple[Fit, RegressionProblem]:
    """The fit without candidates, under the variances that it shows, and the problem about it."""
    fit = stage.fit(())
    problem = RegressionProblem.of(stage, candidates, fit)
    return fitted(stage, start(problem, ()), fit), problem


def fitted(stage: Stage, state: SelectionState, like: Fit) -> Fit:
    """The fit with the members of a state, at their amplitudes and the variances beside them.

    like : Fit, with whose weights of poses the search for these begins
    """
    effects = [c.effect for c in state.active]
    return stage.fit(effects, like, state.amplitudes, state.variances)


def _weighs_alike(one: Fit, other: Fit) -> bool:
    return bool(np.allclose(one.weight, other.weight, atol=_SETTLED))


def restricted_to(
    stage: Stage, outcome: Outcome, rest: Sequence[Candidate], candidates: CandidateSet
) -> Outcome:
    """The outcome with a part of its members alone, no candidate tried again."""
    keys = {c.key for c in rest}
    state = replace(outcome.state, problem=replace(outcome.state.problem, candidates=candidates))
    state = state.with_members(tuple(m for m in state.members if m.key in keys))
    return Outcome(outcome.before, fitted(stage, state, outcome.fit), state)


def with_curves(member: Candidate, active: Sequence[Candidate]) -> list[Candidate]:
    """A member and the curves that can do the same, which must not take the place of a named cause."""
    return [member, *(c for c in active if c.covers(member))]


def plausible(stage: Stage, outcome: Outcome) -> Outcome:
    """The outcome without what is far out, one fit after the other."""
    while True:
        rest = [c for c in outcome.active if not (c.named and far_out(outcome.fit, c))]
        if len(rest) == len(outcome.active):
            return outcome
        outcome = restricted_to(stage, outcome, rest, outcome.state.problem.candidates)


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
    asked = candidate_set(linear, suspects)
    outcome = selected(linear, asked, thorough=False)
    readout = stage.model.readout
    scales = _scales_of(stage, outcome.fit, factor)
    if scales:
        stated = readout.rescaled(stated, scales)
        factor = replicate_factor(data, stated)
        model = replace(stage.model, noise_scales=scales)
        stage = replace(stage, model=model, weights=stated / factor)
        known = replace(linear.model, noise_scales=scales)
        linear = replace(linear, weights=stage.weights, model=known)
        outcome = selected(linear, asked, outcome.active, thorough=False)
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
        asked = candidate_set(linear, suspects, grids)
        outcome = selected(linear, asked, active)
    return Search(stage, linear, outcome, factor, statistic, limit)


def _scales_of(stage: Stage, fit: Fit, factor: float) -> Mapping[str, float]:
    """Actual over stated noise of several instruments, where that is another for some of them.

    factor : actual over stated noise by which the stage weighs all of them
    """
    found = noise_scales(fit.observation, stage.scatter, fit.r, fit.J @ fit.span)
    return found and {i.name: factor * found.get(i.name, 1.0) for i in stage.model.instruments}
