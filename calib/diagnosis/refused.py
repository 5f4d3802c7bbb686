"""What the contest held and does not deserve its name: too large to be true, or no help elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.contest import Outcome, contest, left_with
from calib.diagnosis.earned import BY_TIME, CrossValidation
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.verdict import Named, classes

_MOST_ROUNDS = 30
_ASKED_AGAIN = 2  # times that all others may take the place of what went


@dataclass(frozen=True)
class Refused:
    """A candidate that was in, and why it is not named.

    effect : str, of the catalogue, or ``curve over`` what a cause without a name depends on
    """

    effect: str
    where: str
    reason: str

    @classmethod
    def of(cls, candidate: Candidate, reason: str) -> Refused:
        """A candidate refused."""
        name = candidate.effect.kind if candidate.named else f"curve over {candidate.depends_on}"
        return cls(name, candidate.where, reason)


def believed(
    stage: Stage, outcome: Outcome
) -> tuple[Outcome, tuple[Named, ...], Fit, tuple[Refused, ...]]:
    """The contest without what does not deserve its name: its outcome, names, fit, and what went.

    What something stood for that goes may have another cause: the others are asked again, a few times.
    """
    refused: dict[str, Refused] = {}
    for again in range(_MOST_ROUNDS):
        fresh = _unworthy(stage, outcome.fit, outcome.active)
        if not fresh:
            named, after = classes(stage, outcome)
            fresh = [(n.candidate, why) for n in named if (why := implausible(after, n.candidate))]
            if not fresh:
                return outcome, named, after, tuple(refused.values())
        refused |= {c.key: Refused.of(c, why) for c, why in fresh}
        rest = [c for c in outcome.active if c.key not in refused]
        lineup = outcome.lineup.without(refused)
        if again < _ASKED_AGAIN:
            outcome = contest(stage, lineup, rest, outcome.proved, outcome.before)
        else:
            outcome = left_with(stage, replace(outcome, lineup=lineup), rest)
    return nothing(outcome), (), outcome.before, tuple(refused.values())


def _unworthy(stage: Stage, fit: Fit, active: Sequence[Candidate]) -> list[tuple[Candidate, str]]:
    """What must go next, and why; nothing where all may stay.

    Of those that earn nothing the worse half, for what is left may then earn its place.
    """
    found = [(c, why) for c in active if c.named and (why := implausible(fit, c))]
    if found or not active:
        return found
    crossed = CrossValidation(stage, fit)
    accounts = [(c, crossed.ledger([c.effect], c.depends_on in BY_TIME)) for c in active]
    idle = [(c, a) for c, a in accounts if not a.earns]
    idle.sort(key=lambda pair: pair[1].without - pair[1].with_it)
    for c, _ in idle[: (len(idle) + 1) // 2]:
        left = "stretches of time" if c.depends_on in BY_TIME else "configurations"
        found.append((c, f"{left} that are left out are predicted no better with it"))
    if found:
        return found
    together = crossed.ledger([c.effect for c in active], False)
    if len(active) > 1 and not together.earns:
        return [(c, "all found together predict left-out configurations no better") for c in active]
    return []


def plausible(stage: Stage, outcome: Outcome) -> Outcome:
    """The outcome without what is too large to be true, one fit after the other."""
    while True:
        rest = [c for c in outcome.active if not (c.named and implausible(outcome.fit, c))]
        if len(rest) == len(outcome.active):
            return outcome
        outcome = left_with(stage, outcome, rest)


def implausible(fit: Fit, candidate: Candidate) -> str:
    """Why no such thing is met in practice, empty where it is."""
    amounts = candidate.amounts
    values = fit.values[fit.positions(candidate.effect)][-len(amounts) :]
    worst = int(np.argmax(np.abs(values) / candidate.limits))
    p = amounts[worst]
    if abs(values[worst]) <= p.limit:
        return ""
    return (
        f"{p.name} would be {values[worst] / p.scale:.3g} {p.unit}, and beyond {p.limit / p.scale:.3g} "
        f"{p.unit} such an error is not believed"
    )


def nothing(outcome: Outcome) -> Outcome:
    """The outcome as if nothing had been found."""
    before = outcome.before
    view = replace(outcome.view, fit=before)
    return replace(outcome, fit=before, active=(), view=view)
