"""What is believed of what a search selected: causes that earn nothing are dropped by cross-validation.

What went is asked no more, and the others are asked again, for it may have stood for one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.cross_validation import BY_TIME, CrossValidation
from calib.diagnosis.equivalence import Named, classes
from calib.diagnosis.gap import shares_of
from calib.diagnosis.search import Outcome, Search, restricted_to, selected, with_curves
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.noise import counted
from calib.poses import Measurements
from calib.result import fields_of

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
    """A candidate that was selected and not believed, and why.

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


def _unworthy(stage: Stage, fit: Fit, active: Sequence[Candidate]) -> list[tuple[Candidate, Why]]:
    """What must go next, and why; nothing where all may stay.

    Of those that earn nothing the worse half, for what is left may then earn its place.
    """
    by_time = {c.depends_on in BY_TIME for c in active}
    crossed = {way: CrossValidation.of(stage, fit, way) for way in by_time | {False}}
    idle: list[tuple[float, Candidate, Why]] = []
    for c in active:
        timed = c.depends_on in BY_TIME
        errors = crossed[timed].errors([o.effect for o in with_curves(c, active)])
        if not errors.earns:
            gained = errors.without - errors.with_it
            idle.append((gained, c, "time" if timed else "configurations"))
    if idle:
        idle.sort(key=lambda one: one[0])
        return [(c, why) for _, c, why in idle[: (len(idle) + 1) // 2]]
    if len(active) > 1 and not crossed[False].errors([c.effect for c in active]).earns:
        return [(c, "together") for c in active]
    return []


def is_weak(fit: Fit, candidate: Candidate) -> bool:
    """Whether the amounts of a cause are not beyond three of their own deviations, all taken together.

    Those that the readings do not determine have none.
    """
    from scipy.special import chdtrc

    own = fit.model.amounts(candidate.effect)
    own = own[np.abs(fit.span[own]).sum(axis=1) > 0.0]
    cov = fit.covariance[np.ix_(own, own)]
    distance = float(fit.values[own] @ np.linalg.pinv(cov, hermitian=True) @ fit.values[own])
    return not len(own) or float(chdtrc(len(own), distance)) > _BY_CHANCE


@dataclass(frozen=True, eq=False)
class Finding(Search):
    """What is believed of what a search found; ``outcome`` is what of it is left.

    named : tuple of Named, with what the data cannot tell from them; refused : tuple of Refused
    before, after : Fit, exact, of the user's model and with all that is believed
    noise : NoiseLevel, of the readings beside all that is believed
    scale : float, actual over the standard deviation that the stage weighs by
    """

    named: tuple[Named, ...]
    before: Fit
    after: Fit
    refused: tuple[Refused, ...]
    noise: NoiseLevel
    scale: float

    @property
    def counted(self) -> Measurements:
        """The readings that were fitted."""
        return self.stage.data.take(~self.stage.dropped)

    @cached_property
    def shares(self) -> dict[str, float]:
        """Share of each cause in the unmodelled error by its key."""
        return shares_of(self.outcome, self.after, self.scale)

    @property
    def floor(self) -> float:
        """3-D root mean square of the noise alone, m per point."""
        channels = self.stage.model.readout.channels
        return float(np.sqrt(channels.numbers_each(self.counted.seen))) * self.noise.sigma


def finding_of(search: Search) -> Finding:
    """Keep the selected effects that cross-validation supports, and fit them in full.

    What something stood for that goes may have another cause: the others are asked again, a few times.
    """
    stage, linear, outcome = search.stage, search.linear, search.outcome
    before, refused = stage.exact(outcome.before), dict[str, Refused]()

    def believed(outcome: Outcome, named: tuple[Named, ...], after: Fit) -> Finding:
        noise = _noise(stage, after, search.factor)
        told = noise.source == "cell" or after.mixing is not None
        return Finding(
            **fields_of(replace(search, outcome=outcome)),
            named=named,
            before=before,
            after=after,
            refused=tuple(refused.values()),
            noise=noise,
            scale=1.0 if told else noise.factor / search.factor,
        )

    for again in range(_MOST_ROUNDS):
        fresh = _unworthy(linear, outcome.fit, outcome.active)
        if not fresh:
            named, after = classes(linear, outcome)
            after = stage.exact(after)
            # What does not exceed its own deviation only seemed to act, to first order.
            at = [(n, after.model.amounts(n.candidate.effect)) for n in named]
            gone = [n for n, own in at if (np.abs(after.values[own]) <= after.std_of(own)).all()]
            # The best name of an entry may be another than that by which it came in.
            fresh = [(c, "nothing") for n in gone for c in (n.candidate, n.entry.candidate)]
            if not fresh:
                return believed(outcome, named, after)
        refused |= {c.key: Refused.of(c, why) for c, why in fresh}
        rest = [c for c in outcome.active if c.key not in refused]
        asked = outcome.state.problem.candidates.without(refused)
        if again < _ASKED_AGAIN:
            outcome = selected(linear, asked, rest, outcome)
        else:
            outcome = restricted_to(linear, outcome, rest, asked)
    nothing = restricted_to(linear, outcome, (), outcome.state.problem.candidates)
    return believed(nothing, (), before)


def _noise(stage: Stage, fit: Fit, factor: float) -> NoiseLevel:
    """Noise from the residual of the final model, the stated one or the repeats' where they agree."""
    kept = ~stage.dropped
    weights = stage.weights[kept] * factor
    dof = int(counted(weights).sum()) - fit.spent
    data, readout = stage.data.take(kept), stage.model.readout
    alone = noise_level(fit.cost * factor**2, dof, data, weights, readout)
    if alone.source == "residual" and fit.levels is not None and fit.levels.instrument_only:
        # What the markers of one reading say of each other repeats in every reading.
        return replace(alone, source="replicates")
    if fit.mixing is None or fit.levels is None:
        return alone
    found = of_levels(fit.levels, alone)
    return replace(found, factor=found.factor * factor)
