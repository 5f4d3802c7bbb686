"""Selected candidates, each judged with all others in place, and what could take its place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.conditional import Conditional
from calib.diagnosis.state import SelectedEffect, SelectionState
from calib.inference.evidence import score_test
from calib.inference.tails import f_tail

CLOSE = 30.0
"""Gain below the best at which a rival is none."""


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
    adds.
    """
    choice = 2.0 * float(np.log(state.problem.candidates.asked))  # the same for all
    for member in state.members:
        beside, rest = state.without(member)
        asked = [
            c
            for c in state.eligible(rest)
            if c.candidate.key == member.key
            or (not c.candidate.is_like(member.candidate) and c.candidate.echo in ("", member.key))
        ]
        scores = state.scores(beside, asked)
        near = [s for s in scores if s[0] > scores[0][0] - CLOSE]
        gone = state.slope_without(member, beside)
        scores = [*state.answered(beside, near, gone), *scores[len(near) :]]
        rivals = tuple((one.candidate, gain + choice) for gain, one in scores)
        fall, p = _tested(beside, member.own.columns)
        gain = next(gain for c, gain in rivals if c.key == member.key)
        yield JudgedCandidate(member, gain, fall, min(1.0, p * member.candidate.tried), rivals)


def _tested(beside: Conditional, own: IntArray) -> tuple[float, float]:
    """Fall of the sum of squares by columns (k,) of any size, and its F test."""
    products = beside.products
    lengths = products.lengths(own)
    fall, k = score_test(beside.squares(own[None])[0], beside.z[own], lengths)
    freedom = max(1, products.columns.design.freedom - int(k))
    return float(fall), f_tail(float(fall) / max(int(k), 1), max(int(k), 1), freedom)
