"""The regression in which causes are selected: user's model, scatter of every joint, all candidates."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array, IntArray, stacked
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.columns import CandidateSet
from calib.diagnosis.compressed import CompressedColumns
from calib.diagnosis.stage import Stage
from calib.effects.protocol import ElasticEffect
from calib.effects.tuned import Tuned
from calib.identification.variances import (
    LEAST_INSTRUMENT,
    arm_effects,
    as_variances,
    design_of,
    stated_effects,
)
from calib.inference import Design, Prior
from calib.inference.evidence import cholesky_of
from calib.inference.reml import VarianceProblem
from calib.inference.restricted import MixedModel
from calib.observations.linear import LinearProblem, orthonormal

_AMPLITUDES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
_CURVE_AMPLITUDES = np.array([0.01, 0.1, 1.0, 3.0, 10.0])
_WIDE = 10.0  # times an arm's repeatability: what no model follows from one place to the next


@dataclass(frozen=True, eq=False)
class CandidateColumns:
    """A candidate and its columns, in units of its plausible size.

    columns : ndarray of int, shape (k,), in :class:`CompressedColumns`
    """

    candidate: Candidate
    columns: IntArray

    @cached_property
    def amplitudes(self) -> Array:
        """Amplitudes that are tried, shape (s,), in plausible sizes: none beyond what is ever met."""
        if not self.candidate.named:
            return _CURVE_AMPLITUDES
        limits = self.candidate.limits / [p.size for p in self.candidate.amounts]
        largest = max(float(_AMPLITUDES[0]), 1.01 * float(limits.max(initial=0.0)))
        return np.asarray(np.minimum(_AMPLITUDES, _AMPLITUDES[largest >= _AMPLITUDES].max()))


@dataclass(frozen=True, eq=False)
class RegressionProblem:
    """All of it about one fit.

    levers : ndarray, shape (m, R, n + 6), whitened, of the scatter
    base : CompressedColumns, with the candidates that have no tuning, ``fixed``
    rows : CompressedColumns, with the candidates that are looked at, ``shown``
    variances : VarianceProblem, bounds and priors of the variances
    """

    stage: Stage
    candidates: CandidateSet
    levers: Array
    base: CompressedColumns
    fixed: tuple[CandidateColumns, ...]
    rows: CompressedColumns
    shown: tuple[CandidateColumns, ...]
    variances: VarianceProblem

    @classmethod
    def of(cls, stage: Stage, candidates: CandidateSet, span: Array) -> RegressionProblem:
        """Compress the columns.

        span : ndarray, shape (p, k), directions of the user's model that are fitted
        """
        levers = stage.observation(stage.model).rows(stage.scatter.levers)
        linear = LinearProblem(candidates.r, candidates.J, span, *candidates.held)
        design, prior = _design(stage, linear, levers)
        rows = CompressedColumns.of(design)
        variances = VarianceProblem.of(MixedModel.of(design), prior)
        found = cls(stage, candidates, levers, rows, (), rows, (), variances)
        rows, fixed = found._appended([(c, candidates.rows_of(c)) for c in candidates.fixed])
        return replace(found, base=rows, fixed=fixed, rows=rows, shown=fixed)

    @property
    def elastic(self) -> bool:
        """Whether the user's model holds something elastic."""
        return any(isinstance(e, ElasticEffect) for e in self.stage.model.effects)

    def with_tuned(self, members: Sequence[Candidate]) -> RegressionProblem:
        """The problem with columns of members that have a tuning."""
        return self._with(list(self._tuned(members)))

    def scanned(
        self, members: Sequence[tuple[Candidate, float]], theta: Array, rivals: bool = False
    ) -> RegressionProblem:
        """The problem with members' tunings, and the best of each grid beside them.

        members : candidates with their amplitudes; rivals : whether also with what follows the clock
            in the place of each that does
        """
        present, tunings = [c for c, _ in members], list[tuple[Candidate, Array]]()
        if self.candidates.grids:
            beside = self._linear(members, theta).complement
            tunings += self.candidates.tunings(beside, present)
        for c in present if rivals and self.candidates.grids else ():
            if c.named and c.depends_on == "time":
                rest = [own for own in members if not (own[0] is c or own[0].covers(c))]
                beside = self._linear(rest, theta).complement
                tunings += self.candidates.in_place_of(c, beside)
        return self._with([*self._tuned(present), *tunings])

    def narrowed(self, keys: Collection[str]) -> RegressionProblem:
        """The problem without the curves whose keys are not given, until it is scanned again."""
        kept = [c for c in self.shown if c.candidate.named or c.candidate.key in keys]
        own = np.arange(self.rows.response + 1)
        columns = np.concatenate([own, *(c.columns for c in kept)])
        ends = len(own) + np.cumsum([0, *(len(c.columns) for c in kept)])
        shown = tuple(
            replace(c, columns=np.arange(a, b))
            for c, a, b in zip(kept, ends, ends[1:], strict=False)
        )
        return replace(self, rows=self.rows.only(columns), shown=shown)

    def _with(self, own: Sequence[tuple[Candidate, Array]]) -> RegressionProblem:
        rows, found = self._appended(own)
        return replace(self, rows=rows, shown=self.fixed + found)

    def _tuned(self, members: Sequence[Candidate]) -> Iterator[tuple[Candidate, Array]]:
        """Rows of members that have a tuning."""
        for c in members:
            if isinstance(c.effect, Tuned):
                yield c, self.candidates.rows_of(c)

    def _linear(self, members: Sequence[tuple[Candidate, float]], theta: Array) -> LinearProblem:
        """The least-squares problem at variances theta."""
        design, stage = self.base.design, self.stage
        flat = np.zeros((design.r.size, self.base.response + 1))
        flat[design.live] = np.column_stack([design.response, design.columns])
        rows = flat.reshape(*design.r.shape, -1)
        own = [self.candidates.rows_of(c) @ root_of(c) for c, _ in members]
        J = np.concatenate([rows[..., 1:], *own], axis=-1)
        sizes = [np.full(X.shape[-1], size) for X, (_, size) in zip(own, members, strict=True)]
        known = np.concatenate([self.base.precision, *(size**-2.0 for size in sizes)])
        held = np.diag(np.sqrt(known))[known > 0.0]
        found = as_variances(stage.scatter.joints, design, design.variances(theta), stage.arm)
        mixing, off = stage.scatter.at(found).mixing(self.levers), np.zeros(len(held))
        return LinearProblem(rows[..., 0], J, np.eye(J.shape[-1]), off, held, mixing)

    def _appended(
        self, own: Sequence[tuple[Candidate, Array]]
    ) -> tuple[CompressedColumns, tuple[CandidateColumns, ...]]:
        """The base with the columns (m, R, k) of candidates, in units of their plausible sizes."""
        if not own:
            return self.base, ()
        scaled = [rows @ root_of(c) for c, rows in own]
        ends = len(self.base) + np.cumsum([0, *(part.shape[-1] for part in scaled)])
        found = tuple(
            CandidateColumns(c, np.arange(a, b))
            for (c, _), a, b in zip(own, ends, ends[1:], strict=False)
        )
        return self.base.with_columns(np.concatenate(scaled, axis=-1)), found


def root_of(candidate: Candidate) -> Array:
    """Coefficients of plausible size, shape (k, k), from such of unit variance."""
    if candidate.spread is None:
        return np.diag([p.size for p in candidate.amounts])
    return cholesky_of(candidate.spread) * candidate.effect.parameters[0].size


def _design(stage: Stage, linear: LinearProblem, levers: Array) -> tuple[Design, Prior]:
    """The user's model to first order, and the scatter of every joint, wide: much is no chance."""
    scatter, robot = stage.scatter, stage.model.robot
    stated = stated_effects(scatter, levers, stage.arm)
    arm = arm_effects(scatter, levers, robot, scatter.has_approaches and stage.arm is None)
    effects = (*(e for e, _ in stated), *(e for e in arm if e.part < scatter.joints))
    usual = _WIDE * usual_repeatability(robot.reach).middle
    scales = {"turns": usual / max(robot.reach / 2.0, 1e-3), "slides": usual}
    known = {effect.kind: variance for effect, variance in stated}
    prior = Prior(scales, known, instrument_least=LEAST_INSTRUMENT, of_logarithm=False)
    return _orthonormal(design_of(linear, effects)), prior


def _orthonormal(design: Design) -> Design:
    """The design with columns of which nothing is known orthonormal, and all others beside them.

    Products then keep their digits.
    """
    Q = orthonormal(stacked(design.J @ design.span))

    def beside(rows: Array) -> Array:
        flat = rows.reshape(len(Q), -1)
        return np.asarray(flat - Q @ (Q.T @ flat)).reshape(rows.shape)

    blocks = tuple(replace(g, columns=beside(g.columns)) for g in design.blocks)
    J = Q.reshape(*design.r.shape, -1)
    return replace(design, r=beside(design.r), J=J, span=np.eye(J.shape[-1]), blocks=blocks)
