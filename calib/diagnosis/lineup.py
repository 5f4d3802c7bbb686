"""The columns of all candidates beside a fit, and with members of the fit taken out again.

A cause with a tuning is tried at every tuning of a grid and in every form (one harmonic or two); the
best one takes part in the selection and pays for the choice among all
(:meth:`calib.diagnosis.screen.Score.counted`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, in_parts
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.linear import LinearModel
from calib.diagnosis.screen import Field, field
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.effects.timed import Timed
from calib.effects.tuned import Tuned
from calib.evidence import VISIBLE
from calib.identification.scan import Carried, carried, falls, times
from calib.linear import Complement, unit
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
class Lineup:
    """All suspects, and derivatives of the readings by them; fits that differ by errors have the same.

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

    def without(self, keys: Collection[str]) -> Lineup:
        """The others."""
        fixed = tuple(c for c in self.fixed if c.key not in keys)
        return replace(self, fixed=fixed, closed=self.closed | frozenset(keys))

    def seen_from(self, fit: Fit, active: Sequence[Candidate]) -> FitView:
        """The suspects beside a fit, weighted as its poses are; active : what is in."""
        poses = fit.observation.data.poses
        tuned = [(c, self.rows_of(fit, c)) for c in active if isinstance(c.effect, Tuned)]
        tuned += self.tunings(fit, fit.linear.complement, active)
        for grid in self.grids:
            others = _at_tunings_of(grid.candidate, active)
            tuned += [(c, _at_tuning(c.effect, self._carrier(fit, grid), poses)) for c in others]
        where = {c.key: self.where[c.key] for c in self.fixed}
        ends = self.J.shape[-1] + np.cumsum([0, *(columns.shape[-1] for _, columns in tuned)])
        for (c, _), a, b in zip(tuned, ends, ends[1:], strict=False):
            where[c.key] = np.arange(a, b)
        suspects = (*self.fixed, *(c for c, _ in tuned))
        rows = np.concatenate([np.zeros((*fit.r.shape, 0)), *(own for _, own in tuned)], axis=-1)
        return FitView(fit, self.J, rows, where, suspects)

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

    def other_tunings(self, view: FitView, member: Candidate) -> Iterator[tuple[Array, Array]]:
        """Rows (m, R, k) and limits (k,) of a member at the tunings that are best without it."""
        grid = next((b for b in self.grids if b.candidate.is_like(member)), None)
        if grid is None:
            return
        fit, own = view.fit, view.fit.positions(member.effect)
        carrier = self._carrier(fit, grid)
        scan = carried(fit.linear.without(own, fit.moving[own]), carrier)
        for form in grid.scanned(scan).forms:
            for functions in form.functions:
                yield times(carrier, functions), form.limits

    def _carrier(self, fit: Fit, grid: TuningGrid) -> Array:
        """Whitened derivatives (m, R, b) by the carrier of a grid."""
        return fit.observation.rows(self.J[..., self.where[grid.candidate.key]])


@dataclass(frozen=True, eq=False)
class FitView:
    """Whitened columns of all candidates at one fit.

    fit : Fit
    J : ndarray, shape (m, c, r, K), as of the lineup
    tuned : ndarray, shape (m, R, T), whitened derivatives by those with a tuning, after all others
    where : dict, candidate -> ndarray of int, its columns; suspects : tuple of Candidate
    """

    fit: Fit
    J: Array
    tuned: Array
    where: dict[str, IntArray]
    suspects: tuple[Candidate, ...]

    @cached_property
    def columns(self) -> Array:
        """Columns of all candidates in independent rows, shape (N, K + T)."""
        linear, K = self.fit.linear, self.J.shape[-1]
        found = np.empty((len(linear.independent[0]), K + self.tuned.shape[-1]))
        for part in in_parts(K, len(found)):
            found[:, :K][:, part] = linear.columns(self.fit.observation.rows(self.J[..., part]))
        found[:, K:] = linear.columns(self.tuned)
        return found

    def rows(self, columns: IntArray) -> Array:
        """Whitened derivatives (m, R, k) by some of the columns."""
        K = self.J.shape[-1]
        tuned = columns >= K
        own = np.empty((*self.tuned.shape[:-1], len(columns)))
        own[..., ~tuned] = self.fit.observation.rows(self.J[..., columns[~tuned]])
        own[..., tuned] = self.tuned[..., columns[tuned] - K]
        return own

    @cached_property
    def complement(self) -> Field:
        """Candidates and residual with all that is modelled projected out."""
        r, J = self.fit.linear.independent
        return field(J, self.columns, r, self.fit.linear.basis)

    @cached_property
    def by_instrument(self) -> FitView:
        """The view of a fit whose readings err by the instrument alone."""
        return replace(self, fit=self.fit.by_instrument(self.fit.r, self.fit.J))

    def without(self, *members: Candidate) -> Field:
        """The same with some of the fitted effects out again, candidates like the others.

        What it alone explains comes back, as rows of their own: lengths and products are those of
        ``X + U U^T X``, U the directions that it has beside the rest. Parameters of the rest that are
        not determined beside it may be so without it: what they can stand for, it does not alone.
        """
        fit, whole = self.fit, self.complement
        own = np.concatenate([fit.positions(member.effect) for member in members])
        U = fit.linear.freed(own)
        shown = np.delete(U.T @ unit(fit.linear.along[0]), own, axis=1)
        squares, V = np.linalg.eigh(shown @ shown.T)
        U = U @ V[:, squares <= VISIBLE**2]
        # The residual as it would be without the effect, to first order.
        parameters, r = fit.linear.along
        r = r + parameters[:, own] @ fit.moving[own]
        held = sum(len(member.amounts) for member in members)  # rows of priors, which go with them
        return Field(
            U.T @ whole.modelled_part,
            U.T @ r,
            whole.lengths,
            whole.rows - held,
            whole.dof + U.shape[1] - held,
            whole=whole,
        )


def lineup(stage: Stage, suspects: Sequence[Candidate], known: Sequence[TuningGrid] = ()) -> Lineup:
    """The suspects of a stage to first order.

    known : tuning grids of an earlier lineup at the same poses
    """
    whole = stage.model
    if not isinstance(whole, LinearModel):
        raise TypeError("the stage is not to first order")
    tuned = {b.candidate.key: b for b in known or tuning_grids(suspects, stage.data.poses)}
    fixed = tuple(c for c in suspects if not isinstance(c.effect, Tuned))
    at = {c.key: whole.known[id(c.effect)] for c in fixed}
    at |= {k: whole.carried[b.candidate.effect.kind, b.candidate.where] for k, b in tuned.items()}
    return Lineup(fixed, tuple(tuned.values()), whole.columns, at)


def _at_tunings_of(candidate: Candidate, active: Sequence[Candidate]) -> Iterator[Candidate]:
    """A cause at the tunings of others that follow the clock alike: what it would be in their place.

    A camera that moved follows it as a step of the base does.
    """
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
