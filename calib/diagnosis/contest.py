"""The contest of all candidates for what the model does not explain.

Round by round the linear screen looks at every candidate beside the model and the effects found so far;
the best enters if its evidence pays for its parameters and survives Bonferroni over all that were asked;
each effect that entered is then challenged again by every other candidate, and by nothing. After each
change the whole model is fitted anew, nonlinearly and from the nominal values, and screened at that fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.screen import NOTHING, Field, Score, field, score
from calib.diagnosis.stage import Fit, Stage
from calib.poses import IntArray
from calib.se3 import Array

_ALPHA = 0.01  # false entries, over all candidates together
_CURVE_PENALTY = 2.0 * np.log(10.0)
_NAMED_SHARE = 0.9  # of the leader's evidence at which a cause by name is preferred to a curve
_MOST_EFFECTS = 5
_MOST_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Entry:
    """A candidate that is in, judged with all others in place.

    score : Score, its own; p : float; rivals : tuple of (Candidate, gain), the best in its place first
    """

    candidate: Candidate
    score: Score
    rivals: tuple[tuple[Candidate, float], ...]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where the contest ended.

    fit : Fit, with all entries; before : Fit, without
    last : Field, of the candidates beside all that is modelled; scores : their scores
    """

    before: Fit
    fit: Fit
    entries: tuple[Entry, ...]
    last: Field
    scores: dict[str, Score]


def contest(stage: Stage, suspects: Sequence[Candidate]) -> Outcome:
    """Add, exchange and remove candidates until nothing pays."""
    active: list[Candidate] = []
    before = fit = stage.fit(())
    seen: set[frozenset[str]] = set()
    for _ in range(_MOST_ROUNDS):
        found = _better(stage, fit, active, suspects)
        if found is None:
            break
        keys = frozenset(c.key for c in found)
        if keys in seen:
            break
        seen.add(keys)
        active = found
        fit = stage.fit([c.effect for c in active])
    view, columns = stage.view(fit, suspects)
    scores = {c.key: score(view, columns[c.key]) for c in suspects}
    return Outcome(before, fit, _entries(stage, fit, active, suspects), view, scores)


def _better(
    stage: Stage, fit: Fit, active: list[Candidate], suspects: Sequence[Candidate]
) -> list[Candidate] | None:
    """The next set of effects, None where the present one stands."""
    for position, member in enumerate(active):
        rest = active[:position] + active[position + 1 :]
        view, columns = stage.view(fit, suspects, without=member)
        scores = {c.key: score(view, columns[c.key]) for c in suspects}
        if not _pays(scores[member.key], view, len(suspects), member):
            return rest
        best = _leader(scores, view, [c for c in suspects if c not in rest])
        if best is not member and _gain(scores[best.key], view, best) > _margin(
            scores[member.key], view, member
        ):
            return [*rest, best]
    if len(active) >= _MOST_EFFECTS:
        return None
    view, columns = stage.view(fit, suspects)
    scores = {c.key: score(view, columns[c.key]) for c in suspects}
    best = _leader(scores, view, [c for c in suspects if c not in active])
    if not _pays(scores[best.key], view, len(suspects), best):
        return None
    return [*active, best]


def _gain(found: Score, view: Field, candidate: Candidate) -> float:
    """Evidence less the price of its directions (Schwarz), and of having no name."""
    price = found.directions * np.log(len(view.r))
    return found.evidence - float(price) - (0.0 if candidate.named else float(_CURVE_PENALTY))


def _margin(found: Score, view: Field, candidate: Candidate) -> float:
    return _gain(found, view, candidate) + 1.0


def _pays(found: Score, view: Field, asked: int, candidate: Candidate) -> bool:
    enough = _gain(found, view, candidate) > 2.0 * np.log(asked)
    return bool(enough and found.p * asked < _ALPHA)


def _leader(scores: dict[str, Score], view: Field, open_: Sequence[Candidate]) -> Candidate:
    """The best candidate; a cause by name where it explains nearly as much as the best curve."""
    best = max(open_, key=lambda c: _gain(scores[c.key], view, c))
    if best.named:
        return best
    named = [c for c in open_ if c.named]
    if not named:
        return best
    first = max(named, key=lambda c: _gain(scores[c.key], view, c))
    enough = scores[first.key].fall >= _NAMED_SHARE * scores[best.key].fall
    return first if enough else best


def _entries(
    stage: Stage, fit: Fit, active: list[Candidate], suspects: Sequence[Candidate]
) -> tuple[Entry, ...]:
    found = []
    for member in active:
        rest = [c for c in active if c is not member]
        view, columns = stage.view(fit, suspects, without=member)
        scores = {c.key: score(view, columns[c.key]) for c in suspects}
        gains = [(c, _gain(scores[c.key], view, c)) for c in suspects if c not in rest]
        gains.sort(key=lambda pair: -pair[1])
        found.append(Entry(member, scores[member.key], tuple(gains[:_RIVALS])))
    return tuple(found)


_RIVALS = 12
