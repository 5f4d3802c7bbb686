"""Causes that move the readings as a found one does, of whatever kind: its rivals for the name.

The linear gain of a rival misses those that need a few directions more for the same: they lose by the
price of these alone. Here the signal that was found is compared with its best imitation by each cause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.diagnosis.candidates import PARTS, Candidate
from calib.diagnosis.contest import Entry, Outcome
from calib.effects.protocol import ARM

_EXACT = 2e-4  # of a signal that a twin may leave: columns are those of the fit, to first order
_MORE = 3  # directions beyond those of a cause from which on anything can be imitated


@dataclass(frozen=True, eq=False)
class Twin:
    """A cause that imitates another.

    left : float, of the evidence for the other, what it cannot imitate
    more : int, directions that it needs beyond those of the other
    exact : bool, whether both stand for each other whole
    """

    candidate: Candidate
    left: float
    more: int
    exact: bool


def twins(outcome: Outcome, entry: Entry) -> list[Twin]:
    """All causes by name beside an entry, the best imitation first."""
    view = outcome.view
    beside, where = view.without(entry.candidate), view.where
    own = where[entry.candidate.key]
    U, (_, Xr) = beside.directions(own), beside.products(own)
    signal = U.T @ Xr
    spread = max(beside.cost - float(signal @ signal), 0.0) / max(beside.dof - len(signal), 1)
    noise = spread if beside.noise_refuted and spread > 0.0 else 1.0
    active = {c.key for c in outcome.active}
    found = []
    for suspect in outcome.suspects:
        if not suspect.named or suspect.key in active or suspect.is_like(entry.candidate):
            continue
        if suspect.echo not in ("", entry.candidate.key):
            continue
        if _contains(suspect, entry.candidate):
            continue
        V = beside.directions(where[suspect.key])
        if V.shape[1] > U.shape[1] + _MORE:
            continue
        crossed = V.T @ beside.crossed(where[suspect.key], own) @ U
        imitated = crossed @ signal
        left = float(signal @ signal - imitated @ imitated) / noise
        same = V.shape[1] == U.shape[1] > 0
        worst = float(np.linalg.norm(crossed, -2)) if same else 0.0
        exact = 1.0 - worst**2 < _EXACT
        found.append(Twin(suspect, left, max(0, V.shape[1] - U.shape[1]), exact))
    return sorted(found, key=lambda twin: (not twin.exact, twin.left))


def _contains(whole: Candidate, part: Candidate) -> bool:
    """Whether a cause is another one and more: no other name for it."""
    if part.effect.kind in PARTS.get(whole.effect.kind, ()):
        return whole.where == part.where
    sag = whole.effect.kind == part.effect.kind == "gravity_sag"
    return sag and whole.where == ARM
