"""What was found, chosen anew without each part of the readings: its error there, and its constancy.

Refits of what was found say too much of it, for it was chosen by the same poses. So in each fold the
best of a cause's close rivals, at any of their tunings, takes its place; the folds themselves decide
nothing. To first order the price of each choice adds up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.contest import Outcome
from calib.diagnosis.cross_validation import Choice, CrossValidation
from calib.diagnosis.equivalence import CLOSE, Named
from calib.diagnosis.stage import Stage
from calib.diagnosis.stepwise import apart


@dataclass(frozen=True)
class Anew:
    """Errors at what was left out, without and with what was found, 3-D RMS, m.

    again : dict, key of an entry -> share of the folds without which it, or its equal, comes again
    """

    before: float
    after: float
    again: dict[str, float]


def chosen_anew(
    stage: Stage, outcome: Outcome, named: Sequence[Named], by_time: bool = False
) -> Anew | None:
    """Both errors, None where nothing was found.

    stage : to first order, that of the outcome; by_time : whether stretches of time are left out
    """
    if not outcome.active:
        return None
    crossed, active = CrossValidation(stage, outcome.fit), outcome.active
    whole = crossed.ledger([c.effect for c in active], by_time)
    square, again = whole.rms_with**2, {}
    for one in named:
        member = one.entry.candidate
        place = [c.effect for c in apart(member, active)]
        told = crossed.ledger(place, by_time, list(_choices(outcome, one)))
        square += max(told.rms_with**2 - whole.rms_with**2, 0.0)
        again[member.key] = told.again
    return Anew(whole.rms_without, float(np.sqrt(square)), again)


def _choices(outcome: Outcome, named: Named) -> Iterator[Choice]:
    """What might have been found in a cause's place; itself first."""
    entry, view = named.entry, outcome.view
    alike = {c.key.partition(" as ")[0] for c, _ in named.members}
    first = entry.candidate.key

    def name(key: str) -> str:
        return first if key.partition(" as ")[0] in alike else key

    least = entry.rivals[0][1] - CLOSE
    rivals = [c for c, gain in entry.rivals if c.named and gain > least]
    for c in dict.fromkeys([entry.candidate, *rivals]):
        yield Choice(name(c.key), view.rows[..., view.where[c.key]], c.limits)
    for rows, limits in outcome.lineup.other_tunings(view, entry.candidate):
        yield Choice(first, rows, limits)
