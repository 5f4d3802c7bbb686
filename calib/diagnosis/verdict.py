"""From the contest to a verdict: what is named, what only looks alike, what is merely located."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.diagnosis.candidates import Candidate, as_fitted
from calib.diagnosis.contest import Entry, Outcome
from calib.diagnosis.stage import Fit, Stage
from calib.poses import Poses

VerdictName = Literal["no_gap", "explained", "ambiguous", "unknown"]

_TRIED = 5  # close rivals that are fitted in full
_CLOSE = 30.0  # gain below the best at which a rival is not worth a fit
_SAME = 8.0  # difference of -2 log likelihood that tells nothing yet
_MASS = 0.98  # of the likelihood that a class holds together
# Estimated by maximum likelihood from 382 named effects of 560 simulated cases (studies.withheld, seeds
# 4001 and 4002): likelihoods alone are too sure, for forms differ from the catalogue's.
_TEMPER = 0.3
_IN_CLASS = 0.95


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that was found.

    members : tuple of (Candidate, probability), causes that the data cannot tell apart, best first
    """

    entry: Entry
    members: tuple[tuple[Candidate, float], ...]

    @property
    def candidate(self) -> Candidate:
        """The most probable cause."""
        return self.members[0][0]

    @property
    def probability(self) -> float:
        """Of the most probable cause."""
        return self.members[0][1]


def classes(stage: Stage, outcome: Outcome) -> tuple[tuple[Named, ...], Fit]:
    """Close rivals of every named entry, fitted in full; and the fit with the best of each.

    A linear screen can let a wrong geometry imitate an effect; only whole fits are compared.
    """
    chosen = [entry.candidate for entry in outcome.entries]
    found: list[Named] = []
    fit = outcome.fit
    for position, entry in enumerate(outcome.entries):
        if not entry.candidate.named:
            continue
        top = entry.rivals[0][1]
        rivals = [c for c, gain in entry.rivals if c.named and gain > top - _CLOSE][:_TRIED]
        if entry.candidate not in rivals:
            rivals = [entry.candidate, *rivals]
        fits = {c.key: _with(stage, chosen, position, c) for c in rivals}
        prices = _prices(fits)
        rivals.sort(key=lambda c: prices[c.key])
        chosen[position] = rivals[0]
        fit = fits[rivals[0].key]
        found.append(Named(entry, _members(rivals, prices)))
    return tuple(_as_fitted(named, fit, stage.data.poses) for named in found), fit


def _as_fitted(named: Named, fit: Fit, poses: Poses) -> Named:
    first, probability = named.members[0]
    first = as_fitted(first, fit.values[fit.positions(first.effect)], poses)
    return replace(named, members=((first, probability), *named.members[1:]))


def _with(stage: Stage, chosen: Sequence[Candidate], position: int, other: Candidate) -> Fit:
    effects = [c.effect for c in chosen]
    effects[position] = other.effect
    return stage.fit(effects)


def _prices(fits: Mapping[str, Fit]) -> dict[str, float]:
    """-2 log likelihood and Schwarz's price of the directions; infinite where a fit failed.

    Where even the best residual exceeds the stated noise, its size is taken for the noise of all.
    """
    costs = {key: float((fit.r**2).sum()) for key, fit in fits.items()}
    rows = {key: int(np.count_nonzero(np.abs(f.J).sum(axis=-1))) for key, f in fits.items()}
    free = {key: fit.span.shape[1] for key, fit in fits.items()}
    ratios = [cost / max(1, rows[key] - free[key]) for key, cost in costs.items()]
    scale = max(1.0, float(np.nanmin(ratios)))
    prices = {key: costs[key] / scale + free[key] * np.log(max(rows[key], 2)) for key in fits}
    return {key: price if np.isfinite(price) else np.inf for key, price in prices.items()}


def _members(
    rivals: Sequence[Candidate], prices: dict[str, float]
) -> tuple[tuple[Candidate, float], ...]:
    """Rivals that the data cannot tell from the best, with calibrated probabilities."""
    behind = np.array([min(prices[c.key] - prices[rivals[0].key], 700.0) for c in rivals])
    mass = np.cumsum(np.exp(-0.5 * behind)) / np.exp(-0.5 * behind).sum()
    enough = 1 + int(np.argmax(mass >= _MASS))
    count = max(enough, int(np.count_nonzero(behind <= _SAME)))
    weights = np.exp(-0.5 * _TEMPER * behind[:count])
    shares = _IN_CLASS * weights / weights.sum()
    return tuple(zip(rivals[:count], shares.tolist(), strict=True))


def verdict(named: Sequence[Named], outcome: Outcome, something_left: bool) -> VerdictName:
    """The word for it."""
    if not outcome.entries:
        return "unknown" if something_left else "no_gap"
    if something_left or any(not entry.candidate.named for entry in outcome.entries):
        return "unknown"
    return "explained" if all(len(n.members) == 1 for n in named) else "ambiguous"
