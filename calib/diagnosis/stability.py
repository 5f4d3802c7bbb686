"""Stability of names: in how many halves of the configurations a cause comes again.

Each half is fitted to first order at the variances and amplitudes of the whole. A cause comes again
where, beside all other members, no close rival explains the half clearly better than its class does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.diagnosis.conditional import best_amplitude
from calib.diagnosis.equivalence import SAME, Named
from calib.diagnosis.judged import CLOSE
from calib.diagnosis.regression import CandidateColumns
from calib.diagnosis.state import SelectionState

_PAIRS = 5  # of halves
_DIGITS = 1e-9  # of a product: what a half leaves open


def stability(state: SelectionState, named: Sequence[Named]) -> dict[str, float]:
    """Share of the halves in which each cause comes again, by the key of its entry.

    state : with the tunings of rivals
    """
    products = state.conditional.products
    columns, component = products.columns, products.columns.turned.component_of_row
    close = [_close(state, one) for one in named]
    every = (*(m.own for m in state.members), *(c for own in close for c in own))
    used = np.unique(np.concatenate([np.arange(columns.response + 1), *(c.columns for c in every)]))
    place = np.zeros(len(columns), dtype=np.int_)
    place[used] = np.arange(len(used))
    again: dict[str, list[bool]] = {one.entry.candidate.key: [] for one in named}
    for half in _halves(int(component.max()) + 1):
        rows = products.rows[half[component]][:, used]
        G = rows.T @ rows
        for one, rivals in zip(named, close, strict=True):
            again[one.entry.candidate.key].append(_returns(state, G, place, one, rivals))
    return {key: float(np.mean(found)) for key, found in again.items()}


def _halves(count: int) -> list[Mask]:
    """Ten halves of so many configurations, in pairs that complete each other."""
    rng = np.random.default_rng(0)
    firsts = [rng.permutation(count) < count // 2 for _ in range(_PAIRS)]
    return [half for first in firsts for half in (first, ~first)]


def _returns(
    state: SelectionState,
    G: Array,
    place: IntArray,
    named: Named,
    rivals: Sequence[CandidateColumns],
) -> bool:
    """Whether one of the class is the best of all close rivals, or cannot be told from it.

    G : ndarray, shape (u, u), products of the columns that are used; place : where each stands there
    """
    rest = state.rest(named.entry.member)
    columns = state.problem.rows
    held = np.concatenate([np.arange(columns.response), *(m.own.columns for m in rest)])
    prior = [np.full(len(m.own.columns), m.amplitude**-2.0) for m in rest]
    precision = np.concatenate([columns.precision, *prior])
    asked = np.concatenate([c.columns for c in rivals])
    S, z = _beside(G, place[held], precision, place[np.append(asked, columns.response)])
    alike = {_name(c.key) for c, _ in named.members}
    best, mine, at = 0.0, 0.0, 0
    for c in rivals:
        own = slice(at, at + len(c.columns))
        at = own.stop
        gain = _gain(S[own, own], z[own], c.amplitudes) - 2.0 * float(np.log(c.candidate.choices))
        best = max(best, gain)
        mine = max(mine, gain) if _name(c.candidate.key) in alike else mine
    return 0.0 < mine >= best - SAME / 2.0  # half the readings tell half as much


def _close(state: SelectionState, named: Named) -> list[CandidateColumns]:
    """The cause, its class, and all that explains nearly as much in its place."""
    rivals = named.entry.rivals
    keys = [named.entry.candidate.key, *(c.key for c, _ in named.members)]
    keys += [c.key for c, gain in rivals if gain > rivals[0][1] - CLOSE and c.named]
    every = {c.candidate.key: c for c in state.candidates}
    return [every[key] for key in dict.fromkeys(keys) if key in every]


def _name(key: str) -> str:
    """``effect:where``, whatever its number or the cause in whose place it stands."""
    return key.partition(" ")[0]


def _beside(G: Array, held: IntArray, precision: Array, asked: IntArray) -> tuple[Array, Array]:
    """Products (k, k) of the columns asked, and (k,) with the last of them, beside those held."""
    length = np.sqrt(np.diag(G)[held])
    size = np.where(length > 0.0, length, 1.0)
    B = G[np.ix_(held, held)] / np.outer(size, size) + np.diag(precision / size**2 + _DIGITS)
    H = G[np.ix_(held, asked)] / size[:, None]
    left = G[np.ix_(asked, asked)] - H.T @ np.linalg.solve(B, H)
    return left[:-1, :-1], left[:-1, -1]


def _gain(S: Array, z: Array, amplitudes: Array) -> float:
    d, axes = np.linalg.eigh(S)
    gain, _ = best_amplitude(np.maximum(d, 0.0)[None], (axes.T @ z)[None], amplitudes[None])
    return float(gain[0])
