"""Selected candidates, each judged with all others in place, and what could take its place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.conditional import Conditional
from calib.diagnosis.regression import CandidateColumns
from calib.diagnosis.state import Members, Scored, SelectedEffect, SelectionState
from calib.inference.evidence import f_tail, score_test

CLOSE = 30.0
"""Gain below the best at which a rival is none."""
_FIRST, _MOST = 12.0, 3  # rivals whose variances are found anew: how near the best, how many


@dataclass(frozen=True, eq=False)
class JudgedCandidate:
    """A member of a selection beside all others.

    gain : float, decrease of -2 log likelihood by it, less what the choice of a tuning costs
    fall, p : float, by which it lowers the sum of squares, and the probability of as much by chance
    rivals : tuple of (Candidate, gain), all in its place, the best first, itself among them
    """

    member: SelectedEffect
    gain: float
    fall: float
    p: float
    rivals: tuple[tuple[Candidate, float], ...]

    @property
    def candidate(self) -> Candidate:
        """Which it is."""
        return self.member.candidate


def judged(state: SelectionState) -> Iterator[JudgedCandidate]:
    """Every member of a state with the candidates that could take its place.

    All are compared at the variances of the state; those that come close, with what one step of these
    adds; and the first by name, with variances found anew.
    """
    choice = 2.0 * float(np.log(state.problem.candidates.asked))  # the same for all
    for member in state.members:
        beside, rest = state.without(member)
        others = alternatives(member.candidate, state.eligible(rest))
        scores = state.scores(beside, [member.own, *others])
        near = [s for s in scores if s[0] > scores[0][0] - CLOSE]
        near = state.answered(beside, near, state.slope_without(member, beside))
        own = next(gain for gain, one in scores if one.key == member.key)
        scores = _found_anew(state, member, rest, own, [*near, *scores[len(near) :]])
        rivals = tuple((one.candidate, gain + choice) for gain, one in scores)
        fall, p = _tested(beside, member.own.columns)
        gain = next(gain for c, gain in rivals if c.key == member.key)
        yield JudgedCandidate(member, gain, fall, min(1.0, p * member.candidate.tried), rivals)


def alternatives(cause: Candidate, among: Sequence[CandidateColumns]) -> list[CandidateColumns]:
    """Candidates of another kind or place, each once: with the tuning that is best in its place."""
    tuned = [c for c in among if c.candidate.echo == cause.key]
    free = [c for c in among if not c.candidate.echo and not c.candidate.is_like(cause)]
    return [c for c in free if not any(c.candidate.is_like(t.candidate) for t in tuned)] + tuned


def _found_anew(
    state: SelectionState, member: SelectedEffect, rest: Members, own: float, scores: list[Scored]
) -> list[Scored]:
    """Scores with those of the first rivals by name exact, the largest first.

    own : the member's, at the variances of the state
    """
    exact = {member.key: own}
    rivals = [one for gain, one in scores if one.candidate.named and gain > scores[0][0] - _FIRST]
    rivals = [one for one in rivals if one.key != member.key][:_MOST]
    if rivals:
        # Curves over the same are out beside the member as beside its rivals.
        whole = len(rest) + 1 == len(state.members)
        now = state if whole else state.with_members((*rest, member))
        for one in rivals:
            found = state.with_members((*rest, one)).objective
            exact[one.key] = own + now.objective - found
    return sorted([(exact.get(one.key, gain), one) for gain, one in scores], key=lambda s: -s[0])


def _tested(beside: Conditional, own: IntArray) -> tuple[float, float]:
    """Fall of the sum of squares by columns (k,) of any size, and its F test."""
    products = beside.products
    lengths = products.lengths(own)
    fall, k = score_test(beside.squares(own[None])[0], beside.z[own], lengths)
    freedom = max(1, products.columns.design.freedom - int(k))
    return float(fall), f_tail(float(fall) / max(int(k), 1), max(int(k), 1), freedom)
