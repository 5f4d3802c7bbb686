"""The columns of all candidates beside a fit, and with members of the fit taken out again."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.linear import LinearModel
from calib.diagnosis.screen import VISIBLE, Field, field
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.tunings import TuningGrid, tuning_grids
from calib.effects.timed import Timed
from calib.effects.tuned import Tuned
from calib.identification.scan import carried, times
from calib.linear import unit

_MOST_LINES = 2  # of ripple at one joint; of steps one, or two would stand for any curve


@dataclass(frozen=True, eq=False)
class Lineup:
    """All suspects, and derivatives of the readings by them; fits that differ by errors have the same.

    fixed : tuple of Candidate, those without a tuning; grids : tuple of TuningGrid, the others
    J : ndarray, shape (m, C, r, K), SI; where : dict, key of a candidate without a tuning, or of a
        grid's, -> ndarray of int, its columns or its carrier's
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

    def seen_from(
        self, stage: Stage, fit: Fit, active: Sequence[Candidate], fresh: bool
    ) -> tuple[FitView, Lineup]:
        """The suspects beside a fit, weighted as its poses are; and the lineup with tunings listed.

        active : what is in; fresh : whether all tunings are tried, or those of the last short list
        """
        rows = fit.observation.rows(self.J)
        where = {c.key: self.where[c.key] for c in self.fixed}
        view = FitView(fit, rows, where, self.fixed)
        if not self.grids:
            return view, self
        listed, tuned = [], []
        for grid in self.grids:
            carrier = rows[..., self.where[grid.candidate.key]]
            scan = carried(fit.linear.complement, carrier)
            own = grid.scanned(scan) if fresh else grid
            listed.append(own)
            there = [c for c in active if c.is_like(grid.candidate)]
            tuned += [(c, _rows(c, carrier, stage)) for c in there]
            best, functions = own.best(scan, fit.rows)
            best = replace(best, line=1 + max((c.line for c in there), default=0))
            most = 1 if isinstance(best.effect, Timed) else _MOST_LINES
            if best.line <= most and best.key not in self.closed:
                tuned.append((best, times(carrier, functions)))
            echoes = _echoes(grid.candidate, active)
            tuned += [(c, _rows(c, carrier, stage)) for c in echoes]
        ends = rows.shape[-1] + np.cumsum([0, *(columns.shape[-1] for _, columns in tuned)])
        for (c, _), a, b in zip(tuned, ends, ends[1:], strict=False):
            where[c.key] = np.arange(a, b)
        suspects = (*self.fixed, *(c for c, _ in tuned))
        rows = np.concatenate([rows, *(columns for _, columns in tuned)], axis=-1)
        return FitView(fit, rows, where, suspects), replace(self, grids=tuple(listed))

    def other_tunings(self, view: FitView, member: Candidate) -> Iterator[tuple[Array, Array]]:
        """Rows (m, R, k) and limits (k,) of a member at the tunings that are best without it."""
        grid = next((b for b in self.grids if b.candidate.is_like(member)), None)
        if grid is None:
            return
        carrier = view.rows[..., self.where[grid.candidate.key]]
        scan = carried(view.fit.without([member.effect]).linear.complement, carrier)
        for form in grid.scanned(scan).forms:
            for functions in form.functions:
                yield times(carrier, functions), form.limits


@dataclass(frozen=True, eq=False)
class FitView:
    """Whitened columns of all candidates at one fit.

    fit : Fit
    rows : ndarray, shape (m, R, K), whitened derivatives of every candidate, by a tuning none
    where : dict, candidate -> ndarray of int, its columns; suspects : tuple of Candidate
    """

    fit: Fit
    rows: Array
    where: dict[str, IntArray]
    suspects: tuple[Candidate, ...]

    @cached_property
    def columns(self) -> Array:
        """The same of independent rows, shape (N, K)."""
        return self.fit.linear.columns(self.rows)

    @cached_property
    def beside(self) -> Field:
        """Candidates and residual with all that is modelled projected out."""
        r, J = self.fit.linear.independent
        return field(J, self.columns, r, self.fit.linear.basis)

    @cached_property
    def _shown(self) -> Array:
        """Every parameter, determined or not, along the basis, of length one, (k, p)."""
        return unit(self.fit.linear.along[0])

    @cached_property
    def by_instrument(self) -> FitView:
        """The same as if nothing but the instrument erred."""
        return replace(self, fit=self.fit.by_instrument(self.fit.r, self.fit.J))

    def without(self, *members: Candidate) -> Field:
        """The same with some of the fitted effects out again, candidates like the others.

        What it alone explains comes back, as rows of their own: lengths and products are those of
        ``X + U U^T X``, U the directions that it has beside the rest. Parameters of the rest that are
        not determined beside it may be so without it: what they can stand for, it does not alone.
        """
        fit, whole = self.fit, self.beside
        own = np.concatenate([fit.positions(member.effect) for member in members])
        U = fit.linear.freed(own)
        U = _unseen(U, np.delete(U.T @ self._shown, own, axis=1))
        # The residual as it would be without the effect, to first order.
        parameters, r = fit.linear.along
        r = r + parameters[:, own] @ fit.moving[own]
        held = sum(len(member.amounts) for member in members)  # rows of priors, which go with them
        return Field(
            U.T @ whole.hidden,
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
    ends = np.cumsum([0, *map(len, at.values())])
    where = {key: np.arange(a, b) for key, a, b in zip(at, ends, ends[1:], strict=False)}
    J = whole.columns[..., np.concatenate(list(at.values()))]
    return Lineup(fixed, tuple(tuned.values()), J, where)


def _echoes(candidate: Candidate, active: Sequence[Candidate]) -> Iterator[Candidate]:
    """A cause at the tunings of its kind elsewhere: what it would be in their place."""
    for c in active:
        if isinstance(c.effect, Timed) and not c.is_like(candidate) and _as_timed(candidate, c):
            yield replace(candidate.as_tuned(c.effect.tuning), line=0, echo=c.key)


def _as_timed(candidate: Candidate, other: Candidate) -> bool:
    """Whether both follow the clock by one function: a camera that moved does as a step of the base."""
    mine, theirs = candidate.effect, other.effect
    if not (isinstance(mine, Timed) and isinstance(theirs, Timed)):
        return False
    return type(mine).functions is type(theirs).functions


def _unseen(free: Array, shown: Array) -> Array:
    """Of directions (k, c) those that what is visible of other parameters leaves free.

    shown : ndarray, shape (c, p), of length one, in these directions
    """
    squares, V = np.linalg.eigh(shown @ shown.T)
    return np.asarray(free @ V[:, squares <= VISIBLE**2])


def _rows(candidate: Candidate, carrier: Array, stage: Stage) -> Array:
    """Rows (m, R, f b) of a candidate at its tuning."""
    effect = candidate.effect
    if not isinstance(effect, Tuned):
        raise TypeError(f"{candidate.key} has no tuning")
    return times(carrier, effect.functions(stage.data.poses, np.array(effect.tuning)))
