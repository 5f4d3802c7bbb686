"""The columns of all candidates; of those with a tuning, at the tunings that are worth a look.

A cause with a tuning is tried at every tuning of a grid and in every form (one harmonic or two); the
best one takes part in the selection and pays for the choice among all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.linear import LinearModel
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.effects.timed import Timed
from calib.effects.tuned import Tuned
from calib.identification.scan import Carried, carried, falls, times
from calib.linear import Complement
from calib.poses import Poses

_LISTED = 6  # best tunings of the first form at which richer ones are tried
_MOST_LINES = 2  # of ripple at one joint; of steps one, or two would stand for any curve


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

    def falls(self, carried: Carried) -> Array:
        """Fall of the sum of squares at every tuning, shape (C,)."""
        return falls(carried, self.functions, self.limits)

    def only(self, chosen: IntArray) -> TunedForm:
        """The form at a part of its tunings."""
        return TunedForm(self.effect, self.tunings[chosen], self.functions[chosen])


@dataclass(frozen=True, eq=False)
class TuningGrid:
    """The tuning grid of a cause at one place, in every form of the cause.

    candidate : Candidate, of any tuning; poses : Poses
    forms : tuple of TunedForm, those that are looked at, the first at all tunings
    """

    candidate: Candidate
    poses: Poses
    forms: tuple[TunedForm, ...]

    def scanned(self, carried: Carried) -> TuningGrid:
        """The same with a short list of tunings; of richer forms, those and their halves."""
        first = self.forms[0]
        each = first.falls(carried)
        padded = np.pad(each, 1, constant_values=-np.inf)
        peaks = np.flatnonzero((each >= padded[:-2]) & (each >= padded[2:]))
        short = first.only(peaks[np.argsort(-each[peaks], kind="stable")][:_LISTED])
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
            each = form.falls(carried)
            first = int(np.argmax(each))
            gain = float(each[first]) - len(form.limits) * float(np.log(max(rows, 1)))
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


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """All candidates, and derivatives of the readings by them: the same in fits of like values.

    fixed : tuple of Candidate, those without a tuning; grids : tuple of TuningGrid, the others
    J : ndarray, shape (m, c, r, K), SI, of the channels that are read, by the model's own, too
    where : dict, key of a candidate without a tuning, or of a grid's, -> ndarray of int, its columns or
        its carrier's
    closed : keys of candidates that are not offered
    """

    fixed: tuple[Candidate, ...]
    grids: tuple[TuningGrid, ...]
    J: Array
    where: dict[str, IntArray]
    closed: frozenset[str] = frozenset()

    @property
    def asked(self) -> int:
        """How many causes are asked, at whatever tuning."""
        return len(self.fixed) + len(self.grids)

    def without(self, keys: Collection[str]) -> CandidateSet:
        """The others."""
        fixed = tuple(c for c in self.fixed if c.key not in keys)
        return replace(self, fixed=fixed, closed=self.closed | frozenset(keys))

    def tunings(
        self, fit: Fit, beside: Complement, active: Sequence[Candidate]
    ) -> Iterator[tuple[Candidate, Array]]:
        """Causes with a tuning that may enter, each at its best, and their rows (m, R, k).

        beside : what the rows of the fit leave beside all that is in; active : what is in
        """
        for grid in self.grids:
            line = 1 + max((c.line for c in active if c.is_like(grid.candidate)), default=0)
            if line > (1 if isinstance(grid.candidate.effect, Timed) else _MOST_LINES):
                continue
            carrier = self._carrier(fit, grid)
            scan = carried(beside, carrier)
            best, functions = grid.scanned(scan).best(scan, fit.rows)
            best = replace(best, line=line)
            if best.key not in self.closed:
                yield best, times(carrier, functions)

    def rows_of(self, fit: Fit, candidate: Candidate) -> Array:
        """Whitened derivatives (m, R, k) by a candidate, at its tuning."""
        effect = candidate.effect
        if not isinstance(effect, Tuned):
            return fit.observation.rows(self.J[..., self.where[candidate.key]])
        grid = next(g for g in self.grids if g.candidate.is_like(candidate))
        return _at_tuning(effect, self._carrier(fit, grid), fit.observation.data.poses)

    def echoes(self, fit: Fit, active: Sequence[Candidate]) -> Iterator[tuple[Candidate, Array]]:
        """Causes at the tunings of others that follow the clock alike, and their rows (m, R, k).

        A camera that moved follows it as a step of the base does.
        """
        poses = fit.observation.data.poses
        for grid in self.grids:
            for c in _at_tunings_of(grid.candidate, active):
                yield c, _at_tuning(c.effect, self._carrier(fit, grid), poses)

    def _carrier(self, fit: Fit, grid: TuningGrid) -> Array:
        """Whitened derivatives (m, R, b) by the carrier of a grid."""
        return fit.observation.rows(self.J[..., self.where[grid.candidate.key]])


def candidate_set(
    stage: Stage, suspects: Sequence[Candidate], known: Sequence[TuningGrid] = ()
) -> CandidateSet:
    """The suspects of a stage to first order.

    known : tuning grids of an earlier set at the same poses
    """
    whole = stage.model
    if not isinstance(whole, LinearModel):
        raise TypeError("the stage is not to first order")
    tuned = {b.candidate.key: b for b in known or tuning_grids(suspects, stage.data.poses)}
    fixed = tuple(c for c in suspects if not isinstance(c.effect, Tuned))
    at = {c.key: whole.known[id(c.effect)] for c in fixed}
    at |= {k: whole.carried[b.candidate.effect.kind, b.candidate.where] for k, b in tuned.items()}
    return CandidateSet(fixed, tuple(tuned.values()), whole.columns, at)


def _at_tunings_of(candidate: Candidate, active: Sequence[Candidate]) -> Iterator[Candidate]:
    """A cause as it would be in the place of others that follow the clock alike."""
    mine = candidate.effect
    for c in active:
        if not (isinstance(mine, Timed) and isinstance(c.effect, Timed)) or c.is_like(candidate):
            continue
        if type(mine).functions is type(c.effect).functions:
            yield replace(candidate.as_tuned(c.effect.tuning), line=0, echo=c.key)


def _at_tuning(effect: Effect, carrier: Array, poses: Poses) -> Array:
    """Rows (m, R, f b) of an effect at its tuning."""
    if not isinstance(effect, Tuned):
        raise TypeError(f"{effect.kind} has no tuning")
    return times(carrier, effect.functions(poses, np.array(effect.tuning)))
