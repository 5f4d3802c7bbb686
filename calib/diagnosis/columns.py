"""The columns of all candidates; of those with a tuning, at the tunings that are worth a look.

A cause with a tuning is tried at every tuning of a grid and in every form (one harmonic or two); the
best one takes part in the selection and pays for the choice among all.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, in_parts
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.effects.timed import Timed
from calib.effects.tuned import Tuned
from calib.identification.scan import Carried, carried, falls, times
from calib.model import Model
from calib.observations import Points
from calib.observations.linear import Complement
from calib.poses import Poses

_LISTED = 6  # best tunings of the first form at which richer ones are tried


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

    def with_tuning_of(self, other: Effect) -> TuningGrid:
        """The same with the tuning of another cause that follows the clock alike, as it was fitted."""
        first = self.forms[0]
        if (
            not isinstance(other, Tuned)
            or type(other).functions is not type(first.effect).functions
        ):
            return self
        tunings = np.append(first.tunings, other.tuning)
        more = TunedForm(first.effect, tunings, first.effect.functions(self.poses, tunings))
        return replace(self, forms=(more,))

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
    """All candidates, and whitened derivatives of the readings by them, about one fit.

    fixed : tuple of Candidate, those without a tuning; grids : tuple of TuningGrid, the others
    r : ndarray, shape (m, R), residuals with every candidate at nothing
    J : ndarray, shape (m, R, p), by the parameters of the user's model
    held : (h,) and (h, p), rows of unit variance that are known of these beside the readings
    rows : ndarray, shape (m, R, K), by all candidates, SI
    where : dict, key of a candidate without a tuning, or of a grid's, -> ndarray of int, its columns or
        its carrier's
    closed : keys of candidates that are not offered
    """

    poses: Poses
    fixed: tuple[Candidate, ...]
    grids: tuple[TuningGrid, ...]
    r: Array
    J: Array
    held: tuple[Array, Array]
    rows: Array
    where: dict[str, IntArray]
    closed: frozenset[str] = frozenset()

    @property
    def asked(self) -> int:
        """How many causes are asked, at whatever tuning."""
        return len(self.fixed) + len(self.grids)

    @cached_property
    def count(self) -> int:
        """How many rows count."""
        return int(np.count_nonzero(self.J.any(axis=-1)))

    def without(self, keys: Collection[str]) -> CandidateSet:
        """The others."""
        fixed = tuple(c for c in self.fixed if c.key not in keys)
        return replace(self, fixed=fixed, closed=self.closed | frozenset(keys))

    def tunings(
        self, beside: Complement, active: Sequence[Candidate]
    ) -> Iterator[tuple[Candidate, Array]]:
        """Causes with a tuning that may enter, each at its best, and their rows (m, R, k).

        beside : what the readings leave beside all that is in; active : what is in
        """
        for grid in self.grids:
            line = 1 + max((c.line for c in active if c.is_like(grid.candidate)), default=0)
            if line > grid.forms[0].effect.lines:
                continue
            best, rows = self._best(grid, beside)
            best = replace(best, line=line)
            if best.key not in self.closed:
                yield best, rows

    def rows_of(self, candidate: Candidate) -> Array:
        """Whitened derivatives (m, R, k) by a candidate, at its tuning."""
        effect = candidate.effect
        if not isinstance(effect, Tuned):
            return self.rows[..., self.where[candidate.key]]
        grid = next(g for g in self.grids if g.candidate.is_like(candidate))
        return at_tuning(effect, self._carrier(grid), self.poses)

    def in_place_of(
        self, member: Candidate, beside: Complement
    ) -> Iterator[tuple[Candidate, Array]]:
        """Causes that follow the clock, at the tunings that are best without a member, and their rows.

        A base that warms up slowly drifts; a camera that moved follows the clock as its step does.
        beside : what the readings leave beside all that is in but the member
        """
        for grid in self.grids:
            if isinstance(grid.candidate.effect, Timed) and not grid.candidate.is_like(member):
                best, rows = self._best(grid.with_tuning_of(member.effect), beside)
                yield replace(best, line=0, echo=member.key), rows

    def _best(self, grid: TuningGrid, beside: Complement) -> tuple[Candidate, Array]:
        """The best form and tuning of a grid, and its rows (m, R, k)."""
        carrier = self._carrier(grid)
        scan = carried(beside, carrier)
        best, functions = grid.scanned(scan).best(scan, self.count)
        return best, times(carrier, functions)

    def _carrier(self, grid: TuningGrid) -> Array:
        """Whitened derivatives (m, R, b) by the carrier of a grid."""
        return self.rows[..., self.where[grid.candidate.key]]


def candidate_set(
    stage: Stage, fit: Fit, suspects: Sequence[Candidate], grids: Sequence[TuningGrid]
) -> CandidateSet:
    """The suspects of a stage to first order about a fit; grids : of those with a tuning.

    What is missing in a model moves points by millimetres at most, and squares of that do not show.
    """
    fixed = tuple(c for c in suspects if not isinstance(c.effect, Tuned))
    carriers = {b.candidate.key: b.forms[0].effect.carrier for b in grids}
    effects = [*(c.effect for c in fixed), *carriers.values()]
    whole, values = fit.model.extended(fit.values, effects)
    r, J = _linearised(replace(stage.observation(whole), prior=None), values)
    part = {id(effect): np.arange(s.start, s.stop) for effect, s in whole.parts}
    own = len(stage.model.parameters)
    added, moving = np.arange(own, len(fit.values)), fit.moving
    known = stage.observation(stage.model).stated_prior_residuals(fit.values[:own])
    return CandidateSet(
        stage.data.poses,
        fixed,
        tuple(grids),
        r + J[..., added] @ moving[added],
        J[..., :own],
        known,
        J,
        {c.key: part[id(c.effect)] for c in fixed}
        | {key: part[id(carrier)] for key, carrier in carriers.items()},
    )


def _linearised(points: Points, values: Array) -> tuple[Array, Array]:
    """Whitened residuals (m, R) and derivatives (m, R, P), in parts that memory holds."""
    model, data = points.model, points.data
    m, P, shape = (
        len(data),
        len(values),
        (len(model.readout.channels), model.readout.channels.width),
    )
    readings, J = np.empty((m, *shape)), np.empty((*data.read.shape, shape[1], P))
    for part in in_parts(m, math.prod((*shape, P))):
        readings[part], by = model.jacobian(values, data.poses.take(part))
        J[part] = by[np.arange(len(by))[:, None], data.read[part]]
    return points.residuals(readings), points.rows(J)


def columns_at(
    model: Model, values: Array, poses: Poses, effects: Sequence[Effect]
) -> tuple[Array, list[Array]]:
    """Derivatives of readings at poses by a model's parameters, and by each of some further effects.

    Shapes (t, C, r, p), and (t, C, r, k) by its k amounts, at its tuning where it has one.
    """
    carriers = [e.carrier if isinstance(e, Tuned) else e for e in effects]
    whole, everything = model.extended(values, carriers)
    _, J = whole.jacobian(everything, poses)
    found = []
    for effect, carrier in zip(effects, carriers, strict=True):
        own = J[..., whole.positions(carrier)]
        if isinstance(effect, Tuned):
            rows = at_tuning(effect, own.reshape(len(poses), -1, own.shape[-1]), poses)
            own = rows.reshape(*own.shape[:-1], -1)
        found.append(own)
    return J[..., : len(values)], found


def at_tuning(effect: Effect, carrier: Array, poses: Poses) -> Array:
    """Rows (m, R, f b) of an effect at its tuning, of those (m, R, b) of its carrier."""
    if not isinstance(effect, Tuned):
        raise TypeError(f"{effect.kind} has no tuning")
    return times(carrier, effect.functions(poses, np.array(effect.tuning)))
