"""What the contest held and does not deserve its name: it is no help elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.contest import Outcome, contest, left_with
from calib.diagnosis.earned import BY_TIME, CrossValidation
from calib.diagnosis.named import Named, classes
from calib.diagnosis.rounds import apart
from calib.diagnosis.stage import Fit, Stage

Why = Literal["configurations", "time", "together", "nothing", "weak"]

_MOST_ROUNDS = 30
_REASONS: dict[Why, str] = {
    "configurations": "configurations that are left out are predicted no better with it",
    "time": "stretches of time that are left out are predicted no better with it",
    "together": "all found together predict left-out configurations no better",
    "nothing": "in the fit in full it is smaller than its own standard deviation",
    "weak": "smaller than three of its own standard deviations: it is fitted, and not named",
}
_BY_CHANCE = 0.0027  # beyond three standard deviations, of a normal number
_ASKED_AGAIN = 2  # times that all others may take the place of what went


@dataclass(frozen=True)
class Refused:
    """A candidate that was in, and why it is not named.

    effect : str, of the catalogue, or ``curve over`` what a cause without a name depends on
    """

    effect: str
    where: str
    why: Why

    @property
    def reason(self) -> str:
        """Why, in words."""
        return _REASONS[self.why]

    @classmethod
    def of(cls, candidate: Candidate, why: Why) -> Refused:
        """A candidate refused."""
        name = candidate.effect.kind if candidate.named else f"curve over {candidate.depends_on}"
        return cls(name, candidate.where, why)


def believed(
    stage: Stage, outcome: Outcome, exact: Callable[[Fit], Fit]
) -> tuple[Outcome, tuple[Named, ...], Fit, tuple[Refused, ...]]:
    """The contest without what does not deserve its name: its outcome, names, fit, and what went.

    exact : goes on in full with a fit to first order
    What something stood for that goes may have another cause: the others are asked again, a few times.
    """
    refused: dict[str, Refused] = {}
    for again in range(_MOST_ROUNDS):
        fresh = _unworthy(stage, outcome.fit, outcome.active)
        if not fresh:
            named, after = classes(stage, outcome)
            after = exact(after)
            gone = [n for n in named if _is_nothing(after, n.candidate)]
            # The best name of an entry may be another than that by which it came in.
            fresh = [(c, "nothing") for n in gone for c in (n.candidate, n.entry.candidate)]
            if not fresh:
                return outcome, named, after, tuple(refused.values())
        refused |= {c.key: Refused.of(c, why) for c, why in fresh}
        rest = [c for c in outcome.active if c.key not in refused]
        lineup = outcome.lineup.without(refused)
        if again < _ASKED_AGAIN:
            outcome = contest(stage, lineup, rest, outcome.proved, outcome.before)
        else:
            outcome = left_with(stage, replace(outcome, lineup=lineup), rest)
    return nothing(outcome), (), exact(outcome.before), tuple(refused.values())


def _unworthy(stage: Stage, fit: Fit, active: Sequence[Candidate]) -> list[tuple[Candidate, Why]]:
    """What must go next, and why; nothing where all may stay.

    Of those that earn nothing the worse half, for what is left may then earn its place.
    """
    if not active:
        return []
    crossed = CrossValidation(stage, fit)
    accounts = [
        (c, crossed.ledger([o.effect for o in apart(c, active)], c.depends_on in BY_TIME))
        for c in active
    ]
    idle = [(c, a) for c, a in accounts if not a.earns]
    idle.sort(key=lambda pair: pair[1].without - pair[1].with_it)
    if idle:
        worse = [c for c, _ in idle[: (len(idle) + 1) // 2]]
        return [(c, "time" if c.depends_on in BY_TIME else "configurations") for c in worse]
    together = crossed.ledger([c.effect for c in active], False)
    if len(active) > 1 and not together.earns:
        return [(c, "together") for c in active]
    return []


def _is_nothing(fit: Fit, candidate: Candidate) -> bool:
    """Whether nothing of a cause exceeds its own deviation: to first order it seemed to act."""
    own = fit.positions(candidate.effect)[-len(candidate.amounts) :]
    std = np.sqrt(np.diag(fit.covariance))[own]
    return not (np.abs(fit.values[own]) > std).any()


def is_weak(fit: Fit, candidate: Candidate) -> bool:
    """Whether the amounts of a cause are not beyond three of their own deviations, all taken together.

    Those that the readings do not determine have none.
    """
    from scipy.special import chdtrc

    own = fit.positions(candidate.effect)[-len(candidate.amounts) :]
    own = own[np.abs(fit.span[own]).sum(axis=1) > 0.0]
    cov = fit.covariance[np.ix_(own, own)]
    distance = float(fit.values[own] @ np.linalg.pinv(cov, hermitian=True) @ fit.values[own])
    return not len(own) or float(chdtrc(len(own), distance)) > _BY_CHANCE


def plausible(stage: Stage, outcome: Outcome) -> Outcome:
    """The outcome without what is far out, one fit after the other."""
    while True:
        rest = [c for c in outcome.active if not (c.named and far_out(outcome.fit, c))]
        if len(rest) == len(outcome.active):
            return outcome
        outcome = left_with(stage, outcome, rest)


def far_out(fit: Fit, candidate: Candidate) -> str:
    """What of a cause is larger than such errors usually are, empty where nothing is."""
    amounts = candidate.amounts
    values = fit.values[fit.positions(candidate.effect)][-len(amounts) :]
    worst = int(np.argmax(np.abs(values) / candidate.limits))
    p, limit = amounts[worst], float(candidate.limits[worst])
    if abs(values[worst]) <= limit:
        return ""
    return (
        f"its {p.name} of {values[worst] / p.scale:.3g} {p.unit} is far out: beyond "
        f"{limit / p.scale:.3g} {p.unit} such an error is seldom met"
    )


def nothing(outcome: Outcome) -> Outcome:
    """The outcome as if nothing had been found."""
    before = outcome.before
    view = replace(outcome.view, fit=before)
    return replace(outcome, fit=before, active=(), view=view)
