"""Selection of causes by one objective: the penalised restricted likelihood, and what choices cost.

Each member is a block of columns with a normal prior: a cause by name as wide as such errors are, times
an amplitude, a curve likewise. The scatter of every joint is always in, so nothing is believed that is
no more than scatter. Passes of moves lower

    -2 log L(variances, members) + sum over members of their price

by newcomers, exchanges and removals. Moves are proposed by what they would gain at the present
variances and by one Newton step of these; they stand where the objective is lower with variances and
amplitudes found anew. So no set of members comes twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.conditional import Conditional
from calib.diagnosis.regression import RegressionProblem
from calib.diagnosis.state import (
    SETTLED,
    Members,
    Scored,
    SelectedEffect,
    SelectionState,
    is_elastic,
)
from calib.effects.protocol import LoadEffect
from calib.effects.tuned import Tuned

_LEAD = 3.0  # gain by which a rival must lead to take a place
_NEAR, _JUDGED = 50.0, 6  # rivals of a member: by how much they may trail before variances answer
_ASKED = {True: 40, False: 8}  # causes by name, and curves, of which variances are asked as well
_LEADING = {True: 4, False: 2}  # those that are judged at the end
_MUCH = 100.0  # gain of a newcomer before which nothing else is asked, and of a member that stays
_AT_MOST = 6.0  # times what a Newton step of the variances promises, by which they can answer
_CURVES_TOO = 5.0  # times the best name's gain: a curve with less waits until no name pays
_APART = 0.7  # of its gain that a further newcomer keeps beside the first
_AT_ONCE = 8  # newcomers of one pass
_PASSES = 40


def selection(
    problem: RegressionProblem, active: Sequence[Candidate], thorough: bool = True
) -> SelectionState:
    """Add, exchange and remove candidates until nothing lowers the objective.

    active : candidates to begin with; thorough : whether with exchanges and what scatter may hide
    """
    state = start(problem, active).scanned()
    for _ in range(_PASSES):
        better = next(lower_states(state, thorough), None)
        if better is not None:
            state = better.narrowed(state.leading_curves) if state.fresh else better
        elif state.fresh:
            break
        else:
            state = state.scanned()
    return state.numbered()


def start(problem: RegressionProblem, active: Sequence[Candidate]) -> SelectionState:
    """The state with given members, each at the amplitude that is best beside the others."""
    problem = problem.with_tuned(active)
    known = {c.candidate.key: c for c in problem.shown}
    variances = problem.variances
    found = variances.descend(min(variances.starts(None), key=lambda theta: variances.at(theta)[0]))
    state = SelectionState(problem, (), found.theta, found.objective)
    members: Members = tuple(SelectedEffect(known[c.key], 1.0) for c in active)
    return state.with_members(members) if members else state


def lower_states(state: SelectionState, thorough: bool = True) -> Iterator[SelectionState]:
    """States of a lower objective: by newcomers, else by exchanges, by what scatter may hide.

    A state that is not fresh is asked for newcomers without a tuning alone.
    """
    gain, entering = _newcomers(state)
    if not state.fresh and any(isinstance(m.candidate.effect, Tuned) for m in entering):
        return
    leaving = frozenset[str]() if gain > _MUCH else _removed(state)
    moves = [
        (leaving, entering),
        (frozenset(), entering),
        (frozenset(), entering[:1]),
        (leaving, ()),
    ]
    for gone, new in dict.fromkeys(m for m in moves if m[0] or m[1]):
        yield from _lower(state, (*(m for m in state.members if m.key not in gone), *new))
    if not (thorough and state.fresh):
        return
    places = _exchanged(state)
    for chosen in dict.fromkeys((tuple(places), tuple(places)[:1])):
        if chosen:
            moved = {key: places[key] for key in chosen}
            yield from _lower(state, tuple(moved.get(m.key, m) for m in state.members))
    for hidden in _hidden(state):
        yield from _lower(state, (*state.members, hidden))


def _lower(state: SelectionState, members: Members) -> Iterator[SelectionState]:
    """The state with other members, each once, where its objective is lower.

    Loads go where nothing is elastic: they move nothing else.
    """
    members = tuple({m.key: m for m in members}.values())
    if not (state.problem.elastic or any(is_elastic(m.candidate) for m in members)):
        members = tuple(m for m in members if not isinstance(m.candidate.effect, LoadEffect))
    if {m.key for m in members} != {m.key for m in state.members}:
        found = state.with_members(members)
        if found.objective < state.objective - SETTLED:
            yield found


def _removed(state: SelectionState) -> frozenset[str]:
    """Key of the member that is worth least, where it is not worth its price."""
    worths = []
    for member in state.members:
        beside, _ = state.without(member)
        (alone, _), *_ = state.scores(beside, [member.own])
        if alone > _MUCH:
            continue  # no Newton step tells what variances make of so large a change
        gone = state.slope_without(member, beside)
        alone -= float(state.curvature.promised(gone[None])[0])
        worths.append((alone, member))
    worth, worst = min(worths, key=lambda pair: pair[0], default=(0.0, None))
    return frozenset({worst.key}) if worst is not None and worth < 0.0 else frozenset()


def _exchanged(state: SelectionState) -> dict[str, SelectedEffect]:
    """What explains more in the place of members, those that lead most first."""
    found: dict[str, Scored] = {}
    for member in state.members:
        beside, rest = state.without(member)
        asked = [
            c
            for c in state.eligible(rest)
            if not c.candidate.is_like(member.candidate)
            and c.candidate.key != member.key
            and (c.candidate.named or not member.candidate.named)
        ]
        (own, _), *_ = state.scores(beside, [member.own])
        near = [s for s in state.scores(beside, asked) if s[0] > own - _NEAR][:_JUDGED]
        for gain, best in state.answered(beside, near, state.slope_without(member, beside))[:1]:
            if gain > own + _LEAD:
                found[member.key] = gain - own, best
    ordered = sorted(found.items(), key=lambda pair: -pair[1][0])
    return {key: one for key, (_, one) in ordered}


def _newcomers(state: SelectionState) -> tuple[float, Members]:
    """Causes by name that pay, the best and others that hardly share with it; else the best curve.

    Besides, what the best of them gains.
    """
    asked = state.scores(state.conditional, state.eligible(state.members))
    scores = state.answered(state.conditional, _first(asked, _ASKED))
    paying = [s for s in scores if s[0] > 0.0]
    named = [one for _, one in paying if one.candidate.named][:_AT_ONCE]
    most = max((gain for gain, one in paying if one.candidate.named), default=0.0)
    if not named or paying[0][0] > _CURVES_TOO * most:
        return max((g for g, _ in paying), default=0.0), tuple(one for _, one in paying[:1])
    chosen, beside = named[:1], state.conditional.adding(*named[0].block)
    alone = {one.key: gain for gain, one in state.scores(state.conditional, [m.own for m in named])}
    for one in named[1:]:
        (kept, _), *_ = state.scores(beside, [one.own])
        whole = alone[one.key] + state.price(one.candidate)
        if kept > 0.0 and kept + state.price(one.candidate) > _APART * whole:
            chosen.append(one)
            beside = beside.adding(*one.block)
    return most, tuple(chosen)


def _hidden(state: SelectionState) -> Members:
    """Those that lead where little counts as scatter, and may pay: scatter grows by what is missing."""
    eligible = state.eligible(state.members)
    alone = state.problem.variances.low.copy()
    alone[0] = max(1.0, state.theta[0])
    bare = Conditional.of(state.problem.rows.at(alone), [m.block for m in state.members])
    scores = state.scores(state.conditional, eligible)
    hidden = {one.key for _, one in _first(state.scores(bare, eligible), _LEADING)}
    asked = {one.key for _, one in _first(scores, _ASKED)} | hidden
    answered = state.answered(state.conditional, [s for s in scores if s[1].key in asked])
    hidden |= {one.key for _, one in _first(answered, _LEADING)}
    now = {one.key: gain for gain, one in scores}
    return tuple(
        one
        for gain, one in answered
        if one.key in hidden and now[one.key] + _AT_MOST * (gain - now[one.key]) > 0.0
    )


def _first(scores: Sequence[Scored], counts: Mapping[bool, int]) -> list[Scored]:
    """The first so many by name, and the first so many curves."""
    each = {named: [s for s in scores if s[1].candidate.named == named] for named in counts}
    return [s for named, count in counts.items() for s in each[named][:count]]
