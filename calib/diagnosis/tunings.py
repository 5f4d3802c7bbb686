"""Causes with a tuning as suspects: everything that is tried of them, and what is best of it.

Every tuning of a grid and every form (one harmonic or two) is a suspect of its own; the best one takes
part in the contest and pays for the choice among all (:meth:`calib.diagnosis.screen.Score.counted`).
A full scan leaves a short list of tunings, among which later rounds choose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.linear import times
from calib.diagnosis.scan import Beside, scores
from calib.effects.gear_ripple import GearRipple
from calib.effects.tuned import Tuned
from calib.poses import Poses
from calib.se3 import Array

_LISTED = 6  # best tunings of each form that later rounds choose among
_CHUNK = 400  # tunings at a time: memory


@dataclass(frozen=True, eq=False)
class Form:
    """One form of an effect at all its tunings.

    tunings : ndarray, shape (C,), SI; functions : ndarray, shape (C, m, f)
    """

    effect: Tuned
    tunings: Array
    functions: Array

    def only(self, chosen: Array) -> Form:
        """The same at some of its tunings."""
        return Form(self.effect, self.tunings[chosen], self.functions[chosen])


@dataclass(frozen=True, eq=False)
class Bank:
    """All that is tried of a cause at one place.

    candidate : Candidate, of any tuning; forms : tuple of Form, those that are looked at
    tried : int, those that were tried first
    """

    candidate: Candidate
    forms: tuple[Form, ...]
    tried: int

    def scanned(self, around: Beside, carrier: Array, listed: bool = False) -> Bank:
        """The same with a short list of tunings, the best of each form first.

        carrier : ndarray, shape (m, R, b), its whitened rows
        listed : whether a list that is short already is put in order
        """
        found = []
        for form in self.forms:
            falls = _falls(form, around, carrier)
            order = np.argsort(-falls) if listed else _peaks(falls)
            found.append(form.only(order[:_LISTED]))
        return replace(self, forms=tuple(found))

    def best(self, around: Beside, carrier: Array, rows: int) -> tuple[Candidate, Array]:
        """The best of the forms at their first tunings, and its rows (m, R, f b).

        rows : int, that count: a direction more must pay for itself
        """
        worth, chosen = -np.inf, self.forms[0]
        for form in self.forms:
            first = form.only(np.array([0]))
            gain = float(_falls(first, around, carrier)[0])
            gain -= len(form.effect.amplitudes) * float(np.log(rows))
            if gain > worth:
                worth, chosen = gain, first
        effect = chosen.effect.tuned(float(chosen.tunings[0]))
        return replace(self.candidate, effect=effect), times(carrier, chosen.functions[0])


def banks(suspects: Sequence[Candidate], poses: Poses) -> tuple[Bank, ...]:
    """The banks of those suspects that have a tuning and that these poses can speak of."""
    found = []
    for suspect in suspects:
        if not isinstance(suspect.effect, Tuned):
            continue
        forms = [
            Form(form, grid, form.functions(poses, grid))
            for form in _forms(suspect.effect)
            if len(grid := form.grid(poses))
        ]
        if forms:
            tried = sum(len(form.tunings) for form in forms)
            found.append(Bank(replace(suspect, tried=tried), tuple(forms), tried))
    return tuple(found)


def _forms(effect: Tuned) -> Iterator[Tuned]:
    yield effect
    if isinstance(effect, GearRipple):
        yield effect.with_harmonics(2)


def _falls(form: Form, around: Beside, carrier: Array) -> Array:
    limits = np.array([p.limit for p in form.effect.amplitudes])
    parts = [
        scores(around, carrier, form.functions[i : i + _CHUNK], limits)[0]
        for i in range(0, len(form.tunings), _CHUNK)
    ]
    return np.concatenate(parts)


def _peaks(falls: Array) -> Array:
    """Positions of the local maxima, the highest first."""
    padded = np.pad(falls, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((falls >= padded[:-2]) & (falls >= padded[2:]))
    return np.asarray(peaks[np.argsort(-falls[peaks], kind="stable")])
