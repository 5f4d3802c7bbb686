"""What is believed of what a search selected, fitted in full."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.equivalence import Named, classes
from calib.diagnosis.gap import shares_of
from calib.diagnosis.gate import unsupported
from calib.diagnosis.refused import Refused, Why
from calib.diagnosis.search import Search
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise import NoiseLevel, noise_level, of_levels
from calib.noise import counted
from calib.poses import Measurements
from calib.result import fields_of

_BY_CHANCE = 0.0027  # beyond three standard deviations, of a normal number


def is_weak(fit: Fit, candidate: Candidate) -> bool:
    """Whether the amounts of a cause are not beyond three of their own deviations, all taken together.

    Those that the readings do not determine have none.
    """
    from scipy.special import chdtrc

    count, distance = _distance(fit, candidate)
    return not count or float(chdtrc(count, distance)) > _BY_CHANCE


def _distance(fit: Fit, candidate: Candidate) -> tuple[int, float]:
    """How many amounts of a cause are determined, and their squared distance from nothing.

    In standard deviations, of all taken together, at the tuning as it is: a warm-up that takes all day
    may be twice as large and twice as slow, and is no less there.
    """
    own = fit.model.amounts(candidate.effect)
    own = own[np.abs(fit.span[own]).sum(axis=1) > 0.0]
    cov = fit.covariance[np.ix_(own, own)]
    for tuning in np.setdiff1d(
        fit.positions(candidate.effect), fit.model.amounts(candidate.effect)
    ):
        if (variance := fit.covariance[tuning, tuning]) > 0.0:
            shared = fit.covariance[own, tuning]
            cov = cov - np.outer(shared, shared) / variance
    return len(own), float(fit.values[own] @ np.linalg.pinv(cov, hermitian=True) @ fit.values[own])


@dataclass(frozen=True, eq=False)
class Finding(Search):
    """What is believed of what a search found; ``outcome`` is what of it is left.

    named : tuple of Named, with what the data cannot tell from them; refused : tuple of Refused
    in_vain : dict, key -> why, of causes with which left-out poses are predicted no better
    before, after : Fit, with its variances, of the user's model and with all that is believed
    noise : NoiseLevel, of the readings beside all that is believed
    scale : float, actual over the standard deviation that the stage weighs by
    """

    named: tuple[Named, ...]
    before: Fit
    after: Fit
    in_vain: Mapping[str, Why]
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
    """Judge the selected effects by what they did not see, and fit them in full.

    A curve that predicts nothing goes, and so does what is nothing beside its own deviation; causes by
    name that predict nothing stay in the fit, and are not named.
    """
    stage, outcome = search.stage, search.outcome
    in_vain = unsupported(stage, outcome.fit, outcome.active)
    refused: dict[str, Refused] = {}
    gone = [c for c in outcome.active if c.key in in_vain and not c.named]
    gone += [c for c in outcome.active if c.named and _is_nothing(outcome.fit, c)]
    for c in gone:
        refused[c.key] = Refused.of(c, in_vain.get(c.key, "nothing"))
    if refused:
        outcome = outcome.without(stage, refused)
    named, after = classes(stage, outcome)
    before = stage.with_variances(outcome.before)
    after = stage.with_variances(after) if outcome.active else before
    noise = _noise(stage, after, search.factor)
    stated = noise.source == "cell" or after.mixing is not None
    return Finding(
        **fields_of(replace(search, outcome=outcome)),
        named=named,
        before=before,
        after=after,
        in_vain=in_vain,
        refused=tuple(refused.values()),
        noise=noise,
        scale=1.0 if stated else noise.factor / search.factor,
    )


def _is_nothing(fit: Fit, candidate: Candidate) -> bool:
    count, distance = _distance(fit, candidate)
    return distance <= count


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
