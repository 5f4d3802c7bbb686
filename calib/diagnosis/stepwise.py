"""Stepwise selection: which effect leaves a model next, is exchanged, or enters it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.arrays import IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.lineup import FitView
from calib.diagnosis.profile import likelihood_problem
from calib.diagnosis.screen import NOTHING, Field, Score, ScoreRequest, scored
from calib.diagnosis.stage import Stage
from calib.effects.protocol import ElasticEffect, LoadEffect

ALPHA = 0.01
"""Probability of a false entry, over all candidates together."""
_CHALLENGE = 3.0  # gain by which a rival must lead to take a place
_NAMED_SHARE = 0.9  # of the leader's evidence at which a cause by name is preferred to a curve
_CURVES_TOO = 0.2  # of the best curve's gain: a name with more is taken before curves are judged
_MOST_CURVES = 4  # of which more than one seldom means a thing to anybody
_COMES_BACK = 30.0  # gain that one must have that has left: else it would enter and leave in turn
_LENIENT = 3.0  # gain that a member may lack
_BEYOND_DOUBT = 200.0  # gain that no choice of variances takes away
_STANDS = 0.8  # of the gain with which a member has proved itself, above which it need not again
_APART = 0.7  # of its fall that a second newcomer keeps beside the first
_MOST_AT_ONCE = 12
_LEADING = (4, 2)  # causes by name, and curves, whose variances are found anew


@dataclass(frozen=True, eq=False)
class Round:
    """Where a contest stands.

    active : what is in; view : all suspects from the fit with it
    fresh : whether all tunings were tried, not those of a short list alone
    proved : dict, key of a member -> gain with which it last defended its place against all
    left : set, keys of those that went, which must do better to come back
    new : set, keys of members that nobody has challenged yet
    """

    stage: Stage
    active: tuple[Candidate, ...]
    view: FitView
    fresh: bool
    asked: int
    proved: dict[str, float]
    left: set[str] = field(default_factory=set)
    new: set[str] = field(default_factory=set)

    def pays(self, found: Score, candidate: Candidate | None = None) -> bool:
        """Whether a score earns its holder a place among all that were asked."""
        if candidate is not None and candidate.key in self.left and found.gain < _COMES_BACK:
            return False
        return bool(found.gain > 2.0 * np.log(self.asked) and found.p * self.asked < ALPHA)

    def stays(self, found: Score) -> bool:
        """Whether a score is enough for a selected effect to stay.

        It asks a little less than entering does, so that no effect enters and leaves in turn.
        """
        return bool(
            found.gain > 2.0 * np.log(self.asked) - _LENIENT and found.p * self.asked < 10.0 * ALPHA
        )


def next_selection(state: Round) -> tuple[Candidate, ...]:
    """The next set of effects; the same as now where no step improves it."""
    active, view = state.active, state.view
    acting = tuple(c for c in active if not isinstance(c.effect, LoadEffect))
    if len(acting) < len(active) and not anything_elastic(acting, view):
        return acting
    for member in active:
        beside = view.without(*with_curves(member, active))
        own = linear_scores(beside, view, [member])[member.key]
        stands = own.gain > _STANDS * state.proved.get(member.key, np.inf)
        if stands and member.key not in state.new and state.stays(own):
            continue
        rest = tuple(c for c in active if c is not member)
        new = member.key in state.new
        if not new and not state.stays(_defence(state, member, own)):
            return rest
        state.new.discard(member.key)
        best = _challenger(state, member, own, beside)
        if best is not None:
            return (*rest, best)
        state.proved[member.key] = own.gain
    return (*active, *_newcomers(state))


def with_curves(member: Candidate, active: Sequence[Candidate]) -> list[Candidate]:
    """A member and the curves that can do the same, which must not take the place of a named cause."""
    return [member, *(c for c in active if c.covers(member))]


def _challenger(state: Round, member: Candidate, own: Score, beside: Field) -> Candidate | None:
    """What explains more in a member's place, or as much by name."""
    rest = [c for c in state.active if c is not member]
    eligible = [c for c in _eligible(rest, state.view) if c is not member]
    if isinstance(member.effect, ElasticEffect):  # loads move the arm through it alone
        eligible = [c for c in eligible if not isinstance(c.effect, LoadEffect)]
    eligible = [c for c in eligible if not c.is_like(member)]
    if member.named:  # a curve comes in beside it, and it then stands or falls
        eligible = [c for c in eligible if c.named]
    eligible.append(member)
    gains = linear_scores(beside, state.view, eligible)
    best = _leader(gains, eligible, state.pays)
    named = best.named and not member.named
    if best is member or not (named or gains[best.key].gain > own.gain + _CHALLENGE):
        return None
    where = state.view.where
    return best if _kept(beside, where[member.key], where[best.key]) < _APART else None


def _newcomers(state: Round) -> list[Candidate]:
    """What pays beside all that is in: the best, and others by name that hardly share with it.

    Where poses err together, what is missing counts as noise, and what pays all the same is believed;
    only where nothing does, at whatever tuning, are variances found anew with each that leads.
    """
    view = state.view
    eligible = _eligible(state.active, view)
    scores = linear_scores(view.complement, view, eligible)
    chosen = _entering(state, scores, eligible)
    if not chosen and state.fresh and view.fit.mixing is not None:
        scores = _anew(state, scores, eligible)
        chosen = _entering(state, scores, eligible)
    state.proved.update({c.key: scores[c.key].gain for c in chosen if c.key in scores})
    state.new.update(c.key for c in chosen)
    return chosen


def _entering(
    state: Round, scores: dict[str, Score], eligible: Sequence[Candidate]
) -> list[Candidate]:
    """Those that pay by their scores: names first, but where a curve explains far more."""
    paying = sorted(
        (c for c in eligible if state.pays(scores[c.key], c)), key=lambda c: -scores[c.key].gain
    )
    view, named = state.view, [c for c in paying if c.named]
    curve = next((c for c in paying if not c.named), None)
    if curve is not None:
        first = scores[named[0].key] if named else NOTHING
        if first.gain < _CURVES_TOO * scores[curve.key].gain:
            return [curve]
    chosen = named[:1]
    for c in named[1:_MOST_AT_ONCE]:
        if all(
            _kept(view.complement, view.where[c.key], view.where[other.key]) > _APART
            for other in chosen
        ):
            chosen.append(c)
    return chosen


def _kept(beside: Field, own: IntArray, other: IntArray) -> float:
    """Share of the fall by some columns that is left beside others, about."""
    T, U = beside.directions(own), beside.directions(other)
    z, theirs = T.T @ beside.products(own)[1], U.T @ beside.products(other)[1]
    left = z - T.T @ beside.crossed(own, other) @ U @ theirs
    return float(left @ left) / max(float(z @ z), 1e-300)


def _eligible(active: Sequence[Candidate], view: FitView) -> list[Candidate]:
    """Candidates that may enter: only a few curves, and loads only where something is elastic."""
    full = sum(not c.named for c in active) >= _MOST_CURVES
    stiff = not anything_elastic(active, view)
    return [
        c
        for c in view.suspects
        if c not in active
        and not c.echo
        and (c.named or not full)
        and not (stiff and isinstance(c.effect, LoadEffect))
    ]


def anything_elastic(active: Sequence[Candidate], view: FitView) -> bool:
    """Whether the user's model, or what is in, holds something elastic.

    A load moves nothing else, though to first order about an arm that yields its columns stay.
    """
    asked = {id(c.effect) for c in view.suspects}
    effects = [e for e in view.fit.model.effects if id(e) not in asked]
    return any(isinstance(e, ElasticEffect) for e in (*effects, *(c.effect for c in active)))


def _anew(
    state: Round, scores: dict[str, Score], eligible: Sequence[Candidate]
) -> dict[str, Score]:
    """Scores of those that lead, each with variances found anew; of the others none.

    Where to second order, which is never too much, none pays, they are searched for.
    """
    view = state.view
    alone = linear_scores(view.by_instrument.complement, view, eligible)
    leading = [
        c
        for named in (True, False)
        for by in (scores, alone)
        for c in _leading(by, eligible, named)
    ]
    leading = list(dict.fromkeys(leading))
    here = likelihood_problem(state.stage, view, leading)
    found = {c.key: NOTHING for c in eligible}
    found |= {c.key: here.score(c, searched=False) for c in leading}
    if not any(state.pays(found[c.key], c) for c in leading):
        found |= {c.key: here.score(c) for c in leading}
    return found


def _defence(state: Round, member: Candidate, linear: Score) -> Score:
    """Score of a member as a newcomer would have it: without it more counts as noise.

    linear : Score, at the variances that are left beside it, which are too small
    """
    if state.view.fit.mixing is None or linear.gain > _BEYOND_DOUBT:
        return linear
    here = likelihood_problem(state.stage, state.view, [member], with_curves(member, state.active))
    approximate = here.score(member, searched=False)
    return approximate if state.stays(approximate) else here.score(member)


def linear_scores(beside: Field, view: FitView, suspects: Sequence[Candidate]) -> dict[str, Score]:
    """Score of each suspect, those with a tuning counted, at the variances of the fit."""
    asked = [ScoreRequest(view.where[c.key], c.spread, c.limits, c.eliminate) for c in suspects]
    found = scored(beside, asked)
    return {c.key: own.counted(c.choices) for c, own in zip(suspects, found, strict=True)}


def _leading(
    scores: dict[str, Score], suspects: Sequence[Candidate], named: bool
) -> list[Candidate]:
    """The best of those with a name, or of those without."""
    own = [c for c in suspects if c.named == named]
    ordered = sorted(own, key=lambda c: -scores[c.key].gain)[: _LEADING[0 if named else 1]]
    return [c for c in ordered if scores[c.key].evidence > 0.0]


def _leader(
    scores: Mapping[str, Score], eligible: Sequence[Candidate], pays: Callable[[Score], bool]
) -> Candidate:
    """The best candidate; a cause by name where that pays and explains nearly as much as a curve."""
    best = max(eligible, key=lambda c: scores[c.key].gain)
    named = [c for c in eligible if c.named]
    if best.named or not named:
        return best
    first = max(named, key=lambda c: scores[c.key].gain)
    enough = scores[first.key].fall >= _NAMED_SHARE * scores[best.key].fall
    return first if enough and pays(scores[first.key]) else best
