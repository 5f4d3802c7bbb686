"""Where a selection of causes stands: its members, the variances beside them, and the objective.

    -2 log L(variances, members) + sum over members of their price

with the penalised restricted likelihood L of the regression in which the members are blocks of a normal
prior. A price is what the choice among all candidates costs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.compressed import Block
from calib.diagnosis.conditional import Conditional, Curvature, best_amplitude
from calib.diagnosis.regression import CandidateColumns, RegressionProblem
from calib.effects.protocol import Effect, ElasticEffect, LoadEffect
from calib.effects.tuned import Tuned
from calib.identification.variances import as_variances
from calib.inference.restricted import RestrictedLikelihood
from calib.observations.scatter import Variances

_MOST_CURVES = 8  # without a limit a large table takes twice as long, and predicts hardly better
CURVE_PRICE = float(2.0 * np.log(100.0))
"""What a curve must explain beyond a named cause, in -2 log likelihood: odds of a hundred to one."""
_CURVES_KEPT = 24  # that are looked at again before the next scan
_STEPS = 8  # of a search of variances
_TURNS = 2  # of variances and amplitudes
SETTLED = 0.2
"""Change of the objective that is none."""


@dataclass(frozen=True, eq=False)
class SelectedEffect:
    """A member: its columns, and its amplitude in units of its plausible size."""

    own: CandidateColumns
    amplitude: float

    @property
    def candidate(self) -> Candidate:
        """Which it is."""
        return self.own.candidate

    @property
    def key(self) -> str:
        """Of the candidate."""
        return self.own.candidate.key

    @property
    def block(self) -> Block:
        """Its columns and their prior standard deviation."""
        return self.own.columns, self.amplitude


Members = tuple[SelectedEffect, ...]
Scored = tuple[float, SelectedEffect]
"""Decrease of the objective, and the candidate."""


@dataclass(frozen=True, eq=False)
class SelectionState:
    """Where a selection stands.

    members : tuple of SelectedEffect
    theta : ndarray, variances found beside the members; objective : float, with all prices
    fresh : bool, whether all candidates are looked at, at the tunings that are best beside the members
    """

    problem: RegressionProblem
    members: Members
    theta: Array
    objective: float
    fresh: bool = False

    @cached_property
    def conditional(self) -> Conditional:
        """Beside all members, at the present variances."""
        return Conditional.of(self.problem.rows.at(self.theta), [m.block for m in self.members])

    @cached_property
    def curvature(self) -> Curvature:
        """Of the objective about the present variances."""
        model = self.problem.rows.model([m.block for m in self.members])
        likelihood = RestrictedLikelihood(model, self.theta)
        return Curvature(*replace(self.problem.variances, model=model).curvature(likelihood))

    @property
    def candidates(self) -> tuple[CandidateColumns, ...]:
        """All candidates that are looked at, members among them."""
        return self.problem.shown

    @property
    def active(self) -> tuple[Candidate, ...]:
        """The members."""
        return tuple(m.candidate for m in self.members)

    @property
    def amplitudes(self) -> dict[Effect, float]:
        """Amplitude of each member."""
        return {m.candidate.effect: m.amplitude for m in self.members}

    @property
    def variances(self) -> Variances:
        """Those beside the members, of instrument and scatter."""
        design, stage = self.problem.rows.design, self.problem.stage
        found = design.variances(self.theta)
        return as_variances(stage.scatter.joints, design, found, stage.arm)

    def price(self, candidate: Candidate) -> float:
        """What a member must gain."""
        choices = self.problem.candidates.asked * candidate.choices
        return 2.0 * float(np.log(choices)) + (0.0 if candidate.named else CURVE_PRICE)

    def numbered(self) -> SelectionState:
        """The state with causes of one kind at one place numbered from one."""
        found: list[SelectedEffect] = []
        for m in self.members:
            line = 1 + sum(o.candidate.is_like(m.candidate) for o in found)
            tuned = isinstance(m.candidate.effect, Tuned) and m.candidate.line != line
            own = replace(m.own, candidate=replace(m.candidate, line=line)) if tuned else m.own
            found.append(replace(m, own=own))
        return replace(self, members=tuple(found))

    def without(self, member: SelectedEffect) -> tuple[Conditional, Members]:
        """Products without a member and curves that can do the same, and the other members.

        Such curves must not take the place of a cause by name.
        """
        rest = self.rest(member)
        gone = np.concatenate([m.own.columns for m in self.members if m not in rest])
        return self.conditional.without(gone), rest

    def rest(self, member: SelectedEffect) -> Members:
        """The members without one and curves that can do the same."""
        named = member.candidate
        return tuple(m for m in self.members if not (m is member or m.candidate.covers(named)))

    def slope_without(self, member: SelectedEffect, beside: Conditional) -> Array:
        """Change (t,) of the gradient by log variances without a member; none where curves go too."""
        if any(m.candidate.covers(member.candidate) for m in self.members):
            return np.zeros(len(self.theta))
        own, amplitude = member.own.columns[None], np.array([member.amplitude])
        return np.asarray(-beside.changes(own, amplitude)[0])

    def with_members(self, members: Members) -> SelectionState:
        """The state with other members, variances and amplitudes found anew."""
        theta, last = self.theta, members
        for _ in range(_TURNS):
            model = self.problem.rows.model([m.block for m in members])
            variances = replace(self.problem.variances, model=model)
            found = variances.descend(theta, _STEPS, SETTLED)
            theta = found.theta
            likelihood = RestrictedLikelihood(model, theta)
            last, members = members, tuple(_at_amplitudes(members, likelihood))
            if all(m.amplitude == o.amplitude for m, o in zip(members, last, strict=True)):
                break
        objective = found.objective + sum(self.price(m.candidate) for m in last)
        return replace(self, members=last, theta=theta, objective=objective, fresh=False)

    def scanned(self, rivals: bool = False) -> SelectionState:
        """The state with all candidates, at the tunings that are best beside its members.

        rivals : whether also with what follows the clock in the place of each member that does
        """
        present = [(m.candidate, m.amplitude) for m in self.members]
        problem = self.problem.scanned(present, self.theta, rivals)
        return replace(self._on(problem), fresh=True)

    def narrowed(self, keys: frozenset[str]) -> SelectionState:
        """The state without the curves that are neither members nor among these."""
        return self._on(self.problem.narrowed(keys | {m.key for m in self.members}))

    def _on(self, problem: RegressionProblem) -> SelectionState:
        columns = {c.candidate.key: c for c in problem.shown}
        members = tuple(replace(m, own=columns[m.key]) for m in self.members)
        return replace(self, problem=problem, members=members)

    @property
    def leading_curves(self) -> frozenset[str]:
        """Keys of the curves that gain most."""
        curves = [c for c in self.eligible(self.members) if not c.candidate.named]
        scores = self.scores(self.conditional, curves)[:_CURVES_KEPT]
        return frozenset(one.key for _, one in scores)

    def eligible(self, rest: Members) -> list[CandidateColumns]:
        """Candidates that may enter beside the rest: few curves, loads where something is elastic."""
        taken = {m.key for m in rest}
        full = sum(not m.candidate.named for m in rest) >= _MOST_CURVES
        stiff = not (self.problem.elastic or any(is_elastic(m.candidate) for m in rest))
        return [
            c
            for c in self.candidates
            if c.candidate.key not in taken | self.problem.candidates.closed
            and not any(_other_form(c.candidate, m.candidate) for m in rest)
            and (c.candidate.named or not full)
            and not (stiff and isinstance(c.candidate.effect, LoadEffect))
        ]

    def scores(self, beside: Conditional, asked: Sequence[CandidateColumns]) -> list[Scored]:
        """Gain of each candidate less its price, the largest first, at the present variances."""
        found = []
        for group in _by_width(asked):
            own = np.array([c.columns for c in group])
            gains, sizes = beside.gains(own, np.array([c.amplitudes for c in group]))
            for c, gain, size in zip(group, gains.tolist(), sizes.tolist(), strict=True):
                found.append((gain - self.price(c.candidate), SelectedEffect(c, size)))
        return sorted(found, key=lambda pair: -pair[0])

    def answered(
        self, beside: Conditional, scores: Sequence[Scored], gone: Array | float = 0.0
    ) -> list[Scored]:
        """Scores with what one step of the variances adds, the largest first.

        gone : ndarray, shape (t,), change of the gradient by what was taken out
        """
        gain = {one.key: worth for worth, one in scores}
        amplitude = {one.key: one.amplitude for _, one in scores}
        found = []
        for group in _by_width([one.own for _, one in scores]):
            keys = [c.candidate.key for c in group]
            own = np.array([c.columns for c in group])
            change = beside.changes(own, np.array([amplitude[key] for key in keys]))
            more = self.curvature.promised(change + gone)
            for c, key, extra in zip(group, keys, more.tolist(), strict=True):
                found.append((gain[key] + extra, SelectedEffect(c, amplitude[key])))
        return sorted(found, key=lambda pair: -pair[0])


def _by_width(asked: Sequence[CandidateColumns]) -> Iterable[list[CandidateColumns]]:
    groups: dict[int, list[CandidateColumns]] = {}
    for c in asked:
        groups.setdefault(len(c.columns), []).append(c)
    return groups.values()


def _at_amplitudes(members: Members, likelihood: RestrictedLikelihood) -> Iterator[SelectedEffect]:
    """Members at the amplitudes that are best where all others stay.

    In units of its amplitude a member's coefficients have the covariance ``(a^2 S + I)^-1`` and the
    mean ``a (a^2 S + I)^-1 z``.
    """
    of_column = likelihood.model.design.block_of_column
    first = len(likelihood.model.design.blocks) - len(members)
    for i, member in enumerate(members, start=first):
        W = likelihood.inverse[of_column == i]
        d, axes = np.linalg.eigh(W @ W.T)
        z = axes.T @ likelihood.coefficients[of_column == i] / d / member.amplitude
        squares = np.maximum(1.0 / d - 1.0, 0.0) / member.amplitude**2
        _, best = best_amplitude(squares[None], z[None], member.own.amplitudes[None])
        yield replace(member, amplitude=float(best[0]))


def _other_form(one: Candidate, other: Candidate) -> bool:
    return one.is_like(other) and type(one.effect) is not type(other.effect)


def with_curves(member: Candidate, active: Sequence[Candidate]) -> list[Candidate]:
    """A member and the curves that can do the same, which must not take the place of a named cause."""
    return [member, *(c for c in active if c.covers(member))]


def is_elastic(candidate: Candidate) -> bool:
    """Whether loads move the arm through it."""
    return isinstance(candidate.effect, ElasticEffect)
