"""What a selection of causes found, and the search: select, judge noise and outliers, select again."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, Mask
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.columns import CandidateSet, candidate_set, tuning_grids
from calib.diagnosis.judged import JudgedCandidate, judged
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.selection import selection
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.state import SelectionState
from calib.identification.noise import noise_scales, replicate_factor

_MOST_PASSES = 2  # selections beside outliers as the last one shows them


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where a selection ended.

    before : Fit, of the user's model; fit : Fit, with all that entered; state : SelectionState
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
        return self.state.scanned(rivals=True)

    @property
    def suspects(self) -> tuple[Candidate, ...]:
        """All candidates, those with a tuning at the best one."""
        return tuple(c.candidate for c in self.judged.candidates)

    @cached_property
    def entries(self) -> tuple[JudgedCandidate, ...]:
        """Every selected candidate with the candidates that could take its place."""
        return tuple(judged(self.judged))

    def without(self, stage: Stage, keys: Collection[str]) -> Outcome:
        """The outcome without some of its members, which are not offered again."""
        problem = self.state.problem
        problem = replace(problem, candidates=problem.candidates.without(keys))
        rest = tuple(m for m in self.state.members if m.key not in keys)
        state = replace(self.state, problem=problem).with_members(rest)
        return Outcome(self.before, fitted(stage, state, self.before), state)


def fitted(stage: Stage, state: SelectionState, before: Fit) -> Fit:
    """The fit with the members of a state, at their amplitudes and the variances beside them."""
    effects = [c.effect for c in state.active]
    return stage.fit(effects, before.values, state.amplitudes, state.variances)


@dataclass(frozen=True, eq=False)
class Search:
    """Where the search ended.

    stage : Stage, what was fitted
    factor : float, actual over stated noise by readings that were repeated
    statistic : ndarray, shape (m,), of each pose, an outlier's above ``limit``
    """

    stage: Stage
    outcome: Outcome
    factor: float
    statistic: Array
    limit: float


def search(stage: Stage, suspects: Sequence[Candidate], waiting: Mask) -> Search:
    """Select effects that explain the residual; judge noise and outliers beside them; select again.

    stage : Stage, weighed by the noise as stated, without what stands out under the user's model
    waiting : ndarray of bool, shape (m,), poses that stay out
    """
    stated, grids = stage.weights, tuning_grids(suspects, stage.data.poses)
    factor = replicate_factor(stage.data, stated)
    stage = replace(stage, weights=stated / factor)
    asked = candidate_set(stage, stage.fit(), suspects, grids)
    outcome = selected(stage, asked, thorough=False)
    stage, factor = _with_noise_scales(stage, outcome.fit, stated, factor)
    for again in range(_MOST_PASSES):
        fit = outcome.fit
        out, statistic, limit = stage.outliers(fit)
        if again and np.array_equal(out | waiting, stage.dropped):
            break
        stage = replace(stage, dropped=out | waiting)
        active = [c.as_tuned(float(fit.values[fit.positions(c.effect)[0]])) for c in outcome.active]
        del asked, outcome  # the largest arrays of all
        asked = candidate_set(stage, fit, suspects, grids)
        outcome = selected(stage, asked, active)
    return Search(stage, outcome, factor, statistic, limit)


def selected(
    stage: Stage, asked: CandidateSet, active: Sequence[Candidate] = (), thorough: bool = True
) -> Outcome:
    """Select candidates, and fit the model with them.

    active : candidates to begin with; thorough : whether all moves are tried: what comes first need not
        be final
    """
    before = stage.without_causes()
    state = selection(RegressionProblem.of(stage, asked, before.span), active, thorough)
    return Outcome(before, fitted(stage, state, before), state)


def _with_noise_scales(stage: Stage, fit: Fit, stated: Array, factor: float) -> tuple[Stage, float]:
    """The stage with several instruments weighed by their own noise, and what repeats say beside it.

    stated : weights by the noise as stated; factor : actual over stated noise by which the fit weighed
    """
    found = noise_scales(fit.observation, stage.scatter, fit.r, fit.J @ fit.span)
    if not found:
        return stage, factor
    scales = {i.name: factor * found.get(i.name, 1.0) for i in stage.model.instruments}
    stated = stage.model.readout.rescaled(stated, scales)
    factor = replicate_factor(stage.data, stated)
    model = replace(stage.model, noise_scales=scales)
    return replace(stage, model=model, weights=stated / factor), factor
