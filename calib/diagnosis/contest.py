"""The contest of all candidates for what the model does not explain.

Round by round the linear screen looks at every candidate beside the model and the effects found so
far; the best enters if its evidence pays for its parameters and survives Bonferroni over all that were
asked; each effect that entered is then challenged again by every other candidate, and by nothing.
After each change the whole model is fitted anew, nonlinearly and from the nominal values, and screened
at that fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.preference import instead_of
from calib.diagnosis.profile import ground
from calib.diagnosis.screen import NOTHING, Field, Score, score
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.view import Columns, View

ALPHA = 0.01
"""Probability of a false entry, over all candidates together."""
_CHALLENGE = 1.0  # gain by which a rival must lead to take a place
_NAMED_SHARE = 0.9  # of the leader's evidence at which a cause by name is preferred to a curve
_MOST_EFFECTS = 8
_MOST_CURVES = 4  # of which more than one seldom means a thing to anybody
_CALLED = 12  # causes by name, of which some may stand for a curve
_MOST_ROUNDS = 15
_RIVALS = 12
_BEYOND_DOUBT = 200.0  # gain that no choice of variances takes away
_LEADING = (4, 2)  # causes by name, and curves, whose variances are found anew


@dataclass(frozen=True, eq=False)
class Entry:
    """A candidate that is in, judged with all others in place.

    score : Score, its own; rivals : tuple of (Candidate, gain), the best in its place first
    fall : float, by which it lowers the sum of squares, in variances of the instrument
    """

    candidate: Candidate
    score: Score
    fall: float
    rivals: tuple[tuple[Candidate, float], ...]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where the contest ended.

    before, fit : Fit, without and with all that entered; active : tuple of Candidate, what entered
    view : View, of all suspects from the fit
    """

    before: Fit
    fit: Fit
    active: tuple[Candidate, ...]
    view: View
    suspects: Sequence[Candidate]

    @property
    def last(self) -> Field:
        """The candidates beside all that is modelled."""
        return self.view.beside

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """Every candidate that entered, with its rivals."""
        return tuple(_entry(self.view, c, list(self.active), self.suspects) for c in self.active)


def contest(
    stage: Stage,
    suspects: Sequence[Candidate],
    columns: Columns,
    active: Sequence[Candidate] = (),
) -> Outcome:
    """Add, exchange and remove candidates until nothing pays.

    columns : Columns, of the suspects
    active : candidates to begin with, as an earlier contest left them; each must defend its place
    """
    active = list(active)
    before = stage.fit(())
    fit = stage.fit([c.effect for c in active], before) if active else before
    tried: set[frozenset[str]] = {frozenset(c.key for c in active)}
    seen = columns.seen_from(stage, fit)
    for _ in range(_MOST_ROUNDS):
        found = _better(stage, seen, active, suspects)
        if found == active:
            return Outcome(before, fit, tuple(active), seen, suspects)
        keys = frozenset(c.key for c in found)
        if keys in tried:
            break
        tried.add(keys)
        active = found
        fit = stage.fit([c.effect for c in active], fit)
        seen = columns.seen_from(stage, fit)
    # A contest that goes in circles is left with what pays where it stood.
    while (idle := _idle(stage, seen, active, suspects)) is not None:
        active.remove(idle)
        fit = stage.fit([c.effect for c in active], fit)
        seen = columns.seen_from(stage, fit)
    return Outcome(before, fit, tuple(active), seen, suspects)


def _idle(
    stage: Stage, seen_from: View, active: Sequence[Candidate], suspects: Sequence[Candidate]
) -> Candidate | None:
    """The member that pays least of those that do not pay."""
    scores = {}
    for c in active:
        linear = _linear(seen_from.without(c), seen_from, [c])[c.key]
        scores[c] = _defence(stage, seen_from, c, linear)
    idle = [c for c in active if not _pays(scores[c], len(suspects))]
    return min(idle, key=lambda c: scores[c].gain) if idle else None


def _better(
    stage: Stage, seen_from: View, active: list[Candidate], suspects: Sequence[Candidate]
) -> list[Candidate]:
    """The next set of effects; the present one where it stands."""
    for member in active:
        rest = [c for c in active if c is not member]
        scores = _linear(seen_from.without(member), seen_from, suspects)
        own = scores[member.key]
        if not _pays(_defence(stage, seen_from, member, own), len(suspects)):
            return rest
        eligible = [c for c in _eligible(rest, suspects) if c is not member]
        best = _leader(scores, [*eligible, member], len(suspects))
        named = best.named and not member.named
        if best is not member and (named or scores[best.key].gain > own.gain + _CHALLENGE):
            return [*rest, best]
    if len(active) < _MOST_EFFECTS:
        scores = _scores(stage, seen_from, suspects)
        best = _leader(scores, _eligible(active, suspects), len(suspects))
        if _pays(scores[best.key], len(suspects)):
            return [*active, *(_by_name(seen_from.beside, seen_from, best, suspects) or [best])]
    for curve in (c for c in active if not c.named):
        names = _by_name(seen_from.without(curve), seen_from, curve, suspects)
        if names:
            return [*(c for c in active if c is not curve and c not in names), *names]
    return active


def _eligible(active: Sequence[Candidate], suspects: Sequence[Candidate]) -> list[Candidate]:
    """Who may come in beside those that are: of curves no more than a few."""
    full = sum(not c.named for c in active) >= _MOST_CURVES
    return [c for c in suspects if c not in active and (c.named or not full)]


def _by_name(
    beside: Field, seen_from: View, curve: Candidate, suspects: Sequence[Candidate]
) -> list[Candidate]:
    """The named causes that explain what a curve does; none where there are none, or for a name."""
    if curve.spread is None:
        return []
    scores = _linear(beside, seen_from, [c for c in suspects if c.named])
    named = [c for c in suspects if c.named and scores[c.key].gain > 0.0]
    named = sorted(named, key=lambda c: -scores[c.key].gain)[:_CALLED]
    at = [seen_from.where[c.key] for c in named]
    own = seen_from.where[curve.key]
    found = instead_of(beside, own, curve.spread, at, lambda s: _pays(s, len(suspects)))
    return [named[i] for i in found]


def _scores(stage: Stage, seen_from: View, suspects: Sequence[Candidate]) -> dict[str, Score]:
    """Score of every suspect beside what is in.

    Where poses err together only those that lead are worth a look: their variances are found anew.
    """
    scores = _linear(seen_from.beside, seen_from, suspects)
    if seen_from.fit.mixing is None:
        return scores
    alone = _linear(seen_from.by_instrument.beside, seen_from, suspects)
    leading = list(dict.fromkeys(_leading(scores, suspects) + _leading(alone, suspects)))
    here = ground(stage, seen_from, leading)
    return {c.key: NOTHING for c in suspects} | {c.key: here.score(c) for c in leading}


def _defence(stage: Stage, seen_from: View, member: Candidate, linear: Score) -> Score:
    """Score of a member as a newcomer would have it: without it more counts as noise.

    linear : Score, at the variances that are left beside it, which are too small
    """
    if seen_from.fit.mixing is None or linear.gain > _BEYOND_DOUBT:
        return linear
    return ground(stage, seen_from, [member], member).score(member)


def _linear(beside: Field, seen_from: View, suspects: Sequence[Candidate]) -> dict[str, Score]:
    return {c.key: score(beside, seen_from.where[c.key], c.spread, c.limits) for c in suspects}


def _leading(scores: dict[str, Score], suspects: Sequence[Candidate]) -> list[Candidate]:
    """The best of those with a name and of those without."""
    found = []
    for named, count in zip((True, False), _LEADING, strict=True):
        own = [c for c in suspects if c.named == named]
        ordered = sorted(own, key=lambda c: -scores[c.key].gain)[:count]
        found += [c for c in ordered if scores[c.key].evidence > 0.0]
    return found


def _pays(found: Score, asked: int) -> bool:
    return bool(found.gain > 2.0 * np.log(asked) and found.p * asked < ALPHA)


def _leader(scores: dict[str, Score], eligible: Sequence[Candidate], asked: int) -> Candidate:
    """The best candidate; a cause by name where that pays and explains nearly as much as a curve."""
    best = max(eligible, key=lambda c: scores[c.key].gain)
    named = [c for c in eligible if c.named]
    if best.named or not named:
        return best
    first = max(named, key=lambda c: scores[c.key].gain)
    enough = scores[first.key].fall >= _NAMED_SHARE * scores[best.key].fall
    return first if enough and _pays(scores[first.key], asked) else best


def _entry(
    seen_from: View, member: Candidate, active: list[Candidate], suspects: Sequence[Candidate]
) -> Entry:
    rest = [c for c in active if c is not member]
    scores = _linear(seen_from.without(member), seen_from, suspects)
    gains = [(c, scores[c.key].gain) for c in suspects if c not in rest]
    gains.sort(key=lambda pair: -pair[1])
    own = scores[member.key]
    alone = own
    if seen_from.fit.mixing is not None:
        bare = seen_from.by_instrument
        alone = _linear(bare.without(member), bare, [member])[member.key]
    return Entry(member, own, alone.fall, tuple(gains[:_RIVALS]))
