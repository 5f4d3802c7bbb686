"""From the contest to a verdict: what is named, what only looks alike, what is merely located."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.diagnosis.candidates import Candidate, as_fitted
from calib.diagnosis.contest import Entry, Outcome
from calib.diagnosis.prior import curves_price
from calib.diagnosis.screen import refuted
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.twins import Twin, twins
from calib.poses import Poses

VerdictName = Literal["no_gap", "explained", "ambiguous", "unknown"]

_BEYOND_DOUBT = 60.0  # gain of a cause without close rivals that no whole fit takes away
_TRIED = 5  # close rivals that are fitted in full
_ALIKE = 3  # twins that are fitted beside them
_LARGEST = 4  # members of a class with what is listed for its likeness
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
    chosen = {id(entry): entry.candidate for entry in outcome.entries}
    found: list[Named] = []
    fit = outcome.fit
    direction = float(np.log(max(2, outcome.last.rows)))
    for entry in sorted(outcome.entries, key=lambda e: e.score.gain):
        if not entry.candidate.named:
            continue
        rest = [c for key, c in chosen.items() if key != id(entry)]
        others = twins(outcome, entry)
        rivals = [c for c in _close(entry, others) if c not in rest]
        if len(rivals) == 1 and entry.score.gain > _BEYOND_DOUBT:
            found.append(Named(entry, ((entry.candidate, _IN_CLASS),)))
            continue
        fits = {c: stage.fit([*(o.effect for o in rest), c.effect]) for c in rivals}
        without = stage.fit([c.effect for c in rest]) if rest else outcome.before
        prices, nothing = _prices([*fits.values(), without])
        if min(prices) >= nothing:
            del chosen[id(entry)]  # linear evidence that no whole fit bears out
            fit = without
            continue
        ordered = sorted(zip(fits, prices, strict=True), key=lambda pair: pair[1])
        chosen[id(entry)] = ordered[0][0]
        fit = fits[ordered[0][0]]
        found.append(Named(entry, _members(ordered, others, direction)))
    found.sort(key=lambda named: -named.entry.score.gain)
    return tuple(_as_fitted(named, fit, stage.data.poses) for named in found), fit


def _close(entry: Entry, others: Sequence[Twin]) -> list[Candidate]:
    """The entry, what explains nearly as much in its place, and what moves the readings as it does."""
    least = max(0.0, entry.rivals[0][1] - _CLOSE)
    rivals = [c for c, gain in entry.rivals if c.named and gain > least][:_TRIED]
    alike = [t.candidate for t in others if t.exact]
    alike += [t.candidate for t in others if t.left < _SAME and not t.exact][:_ALIKE]
    return list(dict.fromkeys([entry.candidate, *rivals, *alike]))


def _as_fitted(named: Named, fit: Fit, poses: Poses) -> Named:
    first, probability = named.members[0]
    first = as_fitted(first, fit.values[fit.positions(first.effect)], poses)
    return replace(named, members=((first, probability), *named.members[1:]))


def _prices(fits: Sequence[Fit]) -> tuple[list[float], float]:
    """-2 log likelihood (of curves the marginal one) and Schwarz's price, that of the last fit apart.

    Infinite where a fit failed. Where the best residual refutes the stated noise, its size is taken for
    the noise of all. Where whole poses err together, each fit has its own levels of noise.
    """
    scattered = any(fit.mixing is not None for fit in fits)
    costs = np.array([float((fit.r**2).sum()) for fit in fits])
    rows = np.array([max(2, np.count_nonzero(np.abs(fit.J).sum(axis=-1))) for fit in fits])
    free = np.array([fit.span.shape[1] for fit in fits])
    best = int(np.argmin(np.nan_to_num(costs, nan=np.inf) / np.maximum(1, rows - free)))
    dof = max(1, int(rows[best] - free[best]))
    scale = costs[best] / dof if refuted(float(costs[best]), dof) else 1.0
    if scattered:
        costs, scale = np.array([fit.minus_two_log_likelihood() for fit in fits]), 1.0
    curved = [
        curves_price(f.model, f.amplitudes, f.values, f.covariance if f.amplitudes else np.eye(0))
        for f in fits
    ]
    smooth, coefficients = (np.array(part) for part in zip(*curved, strict=True))
    prices = costs / scale + smooth + (free - coefficients) * np.log(rows)
    *own, last = np.where(np.isfinite(prices), prices, np.inf).tolist()
    return own, last


def _members(
    rivals: Sequence[tuple[Candidate, float]], others: Sequence[Twin] = (), direction: float = 0.0
) -> tuple[tuple[Candidate, float], ...]:
    """Rivals (candidate, price) that the data cannot tell from the first; calibrated probabilities.

    Exact twins, and what loses by the price of its further directions alone, belong to them.
    direction : float, that price for one
    """
    behind = np.array([min(price - rivals[0][1], 700.0) for _, price in rivals])
    mass = np.cumsum(np.exp(-0.5 * behind)) / np.exp(-0.5 * behind).sum()
    enough = 1 + int(np.argmax(mass >= _MASS))
    count = max(enough, int(np.count_nonzero(behind <= _SAME)))
    known = {twin.candidate: twin for twin in others}
    chosen = list(range(count))
    for i in range(count, len(rivals)):
        twin = known.get(rivals[i][0])
        if twin is not None and (
            twin.exact or (len(chosen) < _LARGEST and behind[i] - twin.more * direction <= _SAME)
        ):
            chosen.append(i)
    weights = np.exp(-0.5 * _TEMPER * behind[chosen])
    shares = _IN_CLASS * weights / weights.sum()
    return tuple(zip((rivals[i][0] for i in chosen), shares.tolist(), strict=True))


def verdict(named: Sequence[Named], outcome: Outcome, something_left: bool) -> VerdictName:
    """The word for it."""
    curves = [entry for entry in outcome.entries if not entry.candidate.named]
    if not named and not curves:
        return "unknown" if something_left else "no_gap"
    if something_left or curves:
        return "unknown"
    return "explained" if all(len(n.members) == 1 for n in named) else "ambiguous"
