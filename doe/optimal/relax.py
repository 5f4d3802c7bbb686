"""The best weights over all candidates: a small program, priced over the whole pool.

Column generation. A master program over a few hundred candidates gives weights and with them M. The
supergradient at M scores every candidate of the pool in one product; those that would pay enter the
master, until the certified bound and the value agree. The master is an interior point method for the
smooth criteria, measured faster at every size, and a cone program for the others and where levels are
chosen; tests hold the one against the other. (Closest relative: Pillai, Ponte, Fampa, Lee, Singh and
Xie, arXiv 2411.01405, 2024.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.certify import bound
from doe.optimal.conic import conic_weights
from doe.optimal.function import InformationFunction
from doe.optimal.newton import newton_weights

GAP = 1e-4
"""Certified gap, relative, at which the relaxation stops."""
_MOST_ROUNDS = 40
_WARM_ROUNDS = 6
_NEAR = 0.9  # share of the score that enters a plan, below which a candidate without weight leaves
_IDLE = 1e-6  # weight that is none
_DIGITS = 0.02  # precision of a master, of the gap that is left
_MEMORY = 12  # matrices that criteria with many cones look back on
_PATIENCE = 3  # rounds with neither a better bound nor a new candidate: the solver is at its end


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Weights of the best weighted plan and the bound that they prove.

    index : ndarray of int, shape (q,), candidates; weights : ndarray, shape (q,)
    M : ndarray, shape (p, p); G : ndarray, shape (p, p), the supergradient of the bound
    value, bound : float, criterion at M and the proved upper bound over all plans
    rounds : int
    """

    index: IntArray
    weights: Array
    M: Array
    G: Array
    value: float
    bound: float
    rounds: int

    @property
    def gap(self) -> float:
        """Bound over value, less one."""
        return self.bound / self.value - 1.0


def relax(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    *,
    start: IntArray | None = None,
    gap: float = GAP,
    enough: float = 0.0,
) -> Relaxation:
    """Maximise the criterion over weights, certified over every candidate.

    start : ndarray of int, candidates to begin with, as those of a known plan, in place of a search for
        them
    gap : float, certified relative gap at which to stop; a larger one is returned where the solver
        cannot reach it
    enough : float, bound at which to stop in any case
    """
    active, M = _warm_start(criterion, blocks, allowed, _WARM_ROUNDS if start is None else 1)
    if start is not None:
        active = np.union1d(active, start)
    met, precision = [M], _DIGITS
    weights, best, G_best, stalled = np.zeros(0), np.inf, np.zeros_like(M), 0
    for rounds in range(1, _MOST_ROUNDS + 1):
        part, rules = blocks.take(active), allowed.take(active)
        weights, witness = _master(criterion, part, rules, np.array(met[-_MEMORY:]), precision)
        M = part.total(np.arange(len(active)), weights)
        met.append(M)
        value = float(criterion.value(M))
        proofs = [criterion.gradient(M)] + ([] if witness is None else [witness])
        bounds = [bound(G, blocks, allowed) for G in proofs]
        tightest = int(np.argmin(bounds))
        stalled = 0 if bounds[tightest] < best * (1.0 - 0.1 * gap) else stalled + 1
        if bounds[tightest] < best:
            best, G_best = bounds[tightest], proofs[tightest]
        if best <= max(value * (1.0 + gap), enough):
            break
        # No more digits of the master than its candidates deserve.
        precision = max(gap / 4.0, min(precision, _DIGITS * (best / value - 1.0)))
        scores = blocks.scores(proofs[tightest])
        entering = _entering(scores, allowed)
        if np.isin(entering, active).all() and stalled >= _PATIENCE:
            break
        if rounds < _MOST_ROUNDS:
            near = scores[active] >= _NEAR * allowed.thresholds(scores)[allowed.group[active]]
            active = np.union1d(active[near | (weights > _IDLE)], entering)
    return Relaxation(active, weights, M, G_best, value, best, rounds)


def bounded(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, relaxed: Relaxation
) -> Relaxation:
    """The weights of a criterion with value and bound of another that is nearly the same.

    Relaxed anew where the bound there is loose by more than the gap.
    """
    G, value = criterion.gradient(relaxed.M), float(criterion.value(relaxed.M))
    at_hand = replace(relaxed, G=G, value=value, bound=bound(G, blocks, allowed))
    if at_hand.gap <= 2.0 * max(relaxed.gap, GAP):
        return at_hand
    own = relax(criterion, blocks, allowed, start=relaxed.index)
    return own if own.bound < at_hand.bound else at_hand


def _master(
    criterion: InformationFunction, part: Blocks, rules: Allowed, met: Array, precision: float
) -> tuple[Array, Array | None]:
    if criterion.smooth and not rules.chooses_levels:
        try:
            return newton_weights(criterion, part, rules, precision), None
        except np.linalg.LinAlgError:
            pass  # a singular step, on problems at the edge of rank: the cone program may still do
    solved = conic_weights(criterion, part, rules, met)
    if solved is not None:
        return solved
    _, chosen = rules.best(part.scores(criterion.gradient(met[-1])))
    return np.bincount(chosen, minlength=len(part)).astype(float), None


def _warm_start(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, rounds: int
) -> tuple[IntArray, Array]:
    """Candidates and information of so many Frank-Wolfe steps from uniform weights."""
    uniform = np.full(len(blocks), allowed.size / len(blocks))
    M = blocks.total(np.arange(len(blocks)), uniform)
    active: IntArray = np.zeros(0, dtype=int)
    for step in range(rounds):
        scores = blocks.scores(criterion.gradient(M))
        _, chosen = allowed.best(scores)
        active = np.union1d(active, np.union1d(chosen, _entering(scores, allowed)))
        M = M + (blocks.total(chosen) - M) * (2.0 / (step + 3.0))
    return active, M


def _entering(scores: Array, allowed: Allowed) -> IntArray:
    """Best candidates of every level, and somewhat more of them than a plan takes."""
    spare = max(2, 60 // len(allowed.positions))
    found = []
    for members, count in zip(allowed.members, allowed.counts, strict=True):
        own = scores[members]
        k = min(int(count) + spare, len(members)) if count else 0
        found.append(
            members[np.argpartition(own, len(own) - k)[len(own) - k :]] if k else members[:0]
        )
    return np.concatenate(found)
