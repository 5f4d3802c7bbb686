"""The contest of all candidates for what the model does not explain.

Round by round the screen looks at every candidate beside the model and the effects found so far; those
enter whose evidence pays for their parameters and survives Bonferroni over all that were asked; each
effect that entered is then challenged again by every other candidate, and by nothing. After each
change the whole model is fitted anew, to first order about the fit with which the contest began, and
screened at that fit; what the contest ends with is fitted in full by whoever asked for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.lineup import FitView, Lineup, lineup
from calib.diagnosis.screen import Score
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.stepwise import (
    Round,
    anything_elastic,
    linear_scores,
    next_selection,
    with_curves,
)
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tuned import Tuned
from calib.errors import Unsolvable
from calib.identification.noise_level import replicate_factor
from calib.identification.noise_scales import noise_scales

_MOST_ROUNDS = 40  # of a contest from nothing
_MOST_MORE = 12  # of one that goes on from another
_SCANNED_ANEW = 8  # newcomers after which all tunings are tried again
_MOST_PASSES = 2  # contests, while outliers are judged anew


@dataclass(frozen=True, eq=False)
class Entrant:
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
    """Where the contest ended.

    before : Fit, without all that entered; active : tuple of Candidate, what entered
    view : FitView, of all suspects from the fit with that
    lineup : Lineup, the same with all their tunings
    proved : dict, key of a member -> gain with which it last defended its place
    """

    before: Fit
    active: tuple[Candidate, ...]
    view: FitView
    lineup: Lineup
    proved: dict[str, float]

    @property
    def fit(self) -> Fit:
        """With all that entered."""
        return self.view.fit

    @property
    def suspects(self) -> tuple[Candidate, ...]:
        """All candidates, those with a tuning at the best one."""
        return self.view.suspects

    @cached_property
    def entries(self) -> tuple[Entrant, ...]:
        """Every selected candidate with the candidates that could take its place."""
        return tuple(_entry(self.view, c, self.active) for c in self.active)


def contest(
    stage: Stage,
    lineup: Lineup,
    active: Sequence[Candidate] = (),
    proved: Mapping[str, float] | None = None,
    before: Fit | None = None,
) -> Outcome:
    """Add, exchange and remove candidates until nothing pays.

    stage : Stage, to first order
    active : candidates to begin with, as an earlier contest left them
    proved : gains with which they defended their places there; without, each must do so again
    before : Fit, without any, where an earlier contest of the same stage has it
    All tunings are tried at the beginning and before the end, in between those of a short list.
    """
    before = stage.fit(()) if before is None else before
    fit = stage.fit([c.effect for c in active], before) if active else before
    view, listed = lineup.seen_from(stage, fit, active, fresh=True)
    state = Round(stage, tuple(active), view, True, lineup.asked, dict(proved or {}))
    fresh, grown = True, 0
    tried = {frozenset(c.key for c in active)}
    for _ in range(_MOST_MORE if active else _MOST_ROUNDS):
        found = next_selection(state)
        if found == state.active and fresh:
            return Outcome(before, found, view, lineup, state.proved)
        fresh = found == state.active
        found = _numbered(found)
        grown += len(set(found) - set(state.active))
        if not fresh:
            keys = frozenset(c.key for c in found)
            if keys in tried:
                break
            tried.add(keys)
            state.left.update({c.key for c in state.active} - keys)
            fit = stage.fit([c.effect for c in found], fit)
        fresh = fresh or grown >= _SCANNED_ANEW
        grown = 0 if fresh else grown
        view, listed = (lineup if fresh else listed).seen_from(stage, fit, found, fresh)
        state = replace(state, active=found, view=view, fresh=fresh)
    return Outcome(before, state.active, view, lineup, state.proved)


def _numbered(active: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The same with causes of one kind at one place numbered from one."""
    found: list[Candidate] = []
    for c in active:
        line = 1 + sum(other.is_like(c) for other in found)
        found.append(
            c if c.line == line or not isinstance(c.effect, Tuned) else replace(c, line=line)
        )
    return tuple(found)


def restricted_to(stage: Stage, outcome: Outcome, rest: Sequence[Candidate]) -> Outcome:
    """The outcome with a part of its members alone, no candidate tried again."""
    fit = stage.fit([c.effect for c in rest], outcome.fit)
    view, _ = outcome.lineup.seen_from(stage, fit, rest, fresh=True)
    return replace(outcome, active=tuple(rest), view=view)


def _entry(view: FitView, member: Candidate, active: Sequence[Candidate]) -> Entrant:
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
    return Entrant(member, own, alone.fall, tuple(gains))


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


# -- the contest in full: about the exact fit, and anew while noise and outliers are judged anew ----


@dataclass(frozen=True, eq=False)
class Search:
    """Where the contests ended.

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
    outcome = contest(linear, asked)
    readout = stage.model.readout
    scales = _scales_of(stage, outcome.fit, factor)
    if scales:
        stated = readout.rescaled(stated, scales)
        factor = replicate_factor(data, stated)
        model = replace(stage.model, noise_scales=scales)
        stage = replace(stage, model=model, weights=stated / factor)
        known = replace(linear.model, noise_scales=scales)
        linear = replace(linear, weights=stage.weights, model=known)
        outcome = contest(linear, asked)
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
        proved, grids = outcome.proved, asked.grids
        del linear, asked, outcome  # the largest arrays of all
        linear = stage.about(fit, [c.effect for c in suspects])
        asked = lineup(linear, suspects, grids)
        outcome = contest(linear, asked, active, proved)
    return Search(stage, linear, outcome, factor, statistic, limit)


def _scales_of(stage: Stage, fit: Fit, factor: float) -> Mapping[str, float]:
    """Actual over stated noise of several instruments, where that is another for some of them.

    factor : actual over stated noise by which the stage weighs all of them
    """
    found = noise_scales(fit.observation, stage.scatter, fit.r, fit.J @ fit.span)
    return found and {i.name: factor * found.get(i.name, 1.0) for i in stage.model.instruments}
