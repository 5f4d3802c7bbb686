"""Causes with a tuning as suspects: everything that is tried of them, and what is best of it.

Every tuning of a grid and every form (one harmonic or two) is a suspect of its own; the best one takes
part in the contest and pays for the choice among all (:meth:`calib.diagnosis.screen.Score.counted`).
A full scan leaves a short list of tunings, among which later rounds choose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.effects.tuned import Tuned
from calib.identification.scan import Carried, scores
from calib.poses import Poses

_LISTED = 6  # best tunings of each form that later rounds choose among
_CHUNK = 400  # tunings at a time: memory


@dataclass(frozen=True, eq=False)
class TunedForm:
    """One form of an effect, such as one harmonic or two, at some tunings.

    tunings : ndarray, shape (C,), SI; functions : ndarray, shape (C, m, f)
    """

    effect: Tuned
    tunings: Array
    functions: Array

    @cached_property
    def limits(self) -> Array:
        """Magnitudes of its amplitudes beyond which nothing is believed, SI."""
        return (self.effect.allowance or 1.0) * np.array([p.limit for p in self.effect.amplitudes])

    def only(self, chosen: IntArray) -> TunedForm:
        """The same at some of its tunings."""
        return TunedForm(self.effect, self.tunings[chosen], self.functions[chosen])


@dataclass(frozen=True, eq=False)
class TuningGrid:
    """The tuning grid of a cause at one place, in every form of the cause.

    candidate : Candidate, of any tuning; poses : Poses
    forms : tuple of TunedForm, those that are looked at: the first at all tunings, or as listed
    """

    candidate: Candidate
    poses: Poses
    forms: tuple[TunedForm, ...]

    def scanned(self, carried: Carried) -> TuningGrid:
        """The same with a short list of tunings; of richer forms, those and their halves."""
        first = self.forms[0]
        short = first.only(_peaks(_falls(first, carried))[:_LISTED])
        richer = short.effect.richer(short.tunings)
        if richer is None:
            return replace(self, forms=(short,))
        effect, tunings = richer
        more = TunedForm(effect, tunings, effect.functions(self.poses, tunings))
        return replace(self, forms=(short, more))

    def best(self, carried: Carried, rows: int) -> tuple[Candidate, Array]:
        """The best of all forms and tunings that are looked at, and its functions (m, f).

        rows : int, that count: a direction more must pay for itself
        """
        worth, found = -np.inf, self.forms[0].only(np.array([0]))
        for form in self.forms:
            falls = _falls(form, carried)
            first = int(np.argmax(falls))
            gain = float(falls[first]) - len(form.limits) * float(np.log(max(rows, 1)))
            if gain > worth:
                worth, found = gain, form.only(np.array([first]))
        effect = found.effect.tuned(float(found.tunings[0]))
        return replace(self.candidate, effect=effect), found.functions[0]


def tuning_grids(suspects: Sequence[Candidate], poses: Poses) -> tuple[TuningGrid, ...]:
    """The tuning grids of those suspects that have a tuning and that these poses can speak of."""
    found = []
    for suspect in suspects:
        effect = suspect.effect
        if not isinstance(effect, Tuned) or not len(grid := effect.grid(poses)):
            continue
        form = TunedForm(effect, grid, effect.functions(poses, grid))
        # Beside the grid, the richer forms at what is listed of it.
        tried = len(grid) + (2 * _LISTED if effect.richer(grid) is not None else 0)
        found.append(TuningGrid(replace(suspect, tried=tried), poses, (form,)))
    return tuple(found)


def _falls(form: TunedForm, carried: Carried) -> Array:
    parts = [
        scores(carried, form.functions[i : i + _CHUNK], form.limits)[0]
        for i in range(0, len(form.tunings), _CHUNK)
    ]
    return np.concatenate(parts)


def _peaks(falls: Array) -> IntArray:
    """Positions of the local maxima, the highest first."""
    padded = np.pad(falls, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((falls >= padded[:-2]) & (falls >= padded[2:]))
    return np.asarray(peaks[np.argsort(-falls[peaks], kind="stable")])
