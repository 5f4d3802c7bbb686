"""Which causes are rivals still: what the poses to come are to decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.contest import Entry
from calib.diagnosis.rounds import linear_scores

_REACH = 25.0
"""Gain by which a rival may trail and still be in reach: at a predicted probability of 0.95 two
standard deviations above the mean."""
_NEAREST = 3  # rivals of a cause that stands alone
_MOST = 5  # rivals in one place: ten pairs


@dataclass(frozen=True, eq=False)
class Rivalry:
    """Causes that compete for one place among the effects found; the others stay as they are.

    members : tuple of Candidate
    declared : whether the diagnosis itself could not tell them apart
    """

    members: tuple[Candidate, ...]
    declared: bool

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Positions of all two that compete; where nothing is in doubt, the first and each other."""
        count = len(self.members)
        first = range(count) if self.declared else range(1)
        return tuple((i, j) for i in first for j in range(i + 1, count))


def rivalries(diagnosis: Diagnosis) -> tuple[Rivalry, ...]:
    """The places in doubt: classes of several members, else causes with a rival in reach.

    Causes by name only: a curve bends to whatever is there, so that no pose tells it from its rivals.
    """
    if suspicious(diagnosis):
        return _suspected(diagnosis)
    chosen = _chosen(diagnosis)
    ambiguous = any(len(cause.named.causes) > 1 for cause in diagnosis.causes)
    found = []
    for cause in diagnosis.causes:
        members = list(cause.named.causes)
        declared = len(members) > 1
        if not declared and not ambiguous:
            members = [cause.named.candidate, *_near(cause.named.entry, chosen)]
        if len(members) > 1:
            found.append(Rivalry(tuple(members[:_MOST]), declared))
    return tuple(found)


def suspicious(diagnosis: Diagnosis) -> bool:
    """Whether something is there that nothing found accounts for, by name or without."""
    nothing = not diagnosis.causes and not diagnosis.outcome.active
    return nothing and diagnosis.verdict == "unknown"


def _suspected(diagnosis: Diagnosis) -> tuple[Rivalry, ...]:
    """Where something is there and nothing is found, the causes that explain most of it."""
    view = diagnosis.outcome.view.by_instrument
    named = [c for c in view.suspects if c.named and not c.echo]
    scores = linear_scores(view.beside, view, named)
    leading = sorted(named, key=lambda c: -scores[c.key].gain)[:_MOST]
    return (Rivalry(tuple(leading), True),) if len(leading) > 1 else ()


def _chosen(diagnosis: Diagnosis) -> list[Candidate]:
    """What was found, by name or without."""
    curves = [c for c in diagnosis.outcome.active if not c.named]
    return [*(cause.named.candidate for cause in diagnosis.causes), *curves]


def _near(entry: Entry, chosen: Sequence[Candidate]) -> list[Candidate]:
    """Rivals by name whose gain comes close."""
    taken = {c.key for c in chosen}
    top = entry.rivals[0][1]
    near = [c for c, gain in entry.rivals if gain > top - _REACH and c.key not in taken]
    return [c for c in near if c.named and not c.echo][:_NEAREST]
