"""What a plan can tell of causes that no model has yet, before anything is measured.

The plan is seen as the diagnosis will see it: every cause beside everything modelled, and no residual
yet. Of each cause the size that is detected, or why none is; of each two whether they are separated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calib.api import Plan
from calib.arm.statics import loads_of
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.diagnosis.candidates import Candidate, NotAsked, candidates
from calib.diagnosis.detection_limit import ALPHA, Detectable, detectable
from calib.effects.protocol import Effect, ElasticEffect, LoadEffect, Parameter
from calib.effects.tuned import Tuned, amid
from calib.identification.checks import check_counts
from calib.identification.fit import choose_directions
from calib.linear import LinearProblem, orthonormal
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import Unidentifiable
from calib.observations import Points
from calib.poses import Measurements, Poses
from calib.poses.moves import before_the_first_move
from calib.result import Result
from calib.scatter import Variances
from calib.threads import one_blas_thread
from doe.forecast.coming import readings_of
from doe.forecast.likeness import Likeness, likeness, plausible
from doe.information import Linearisation, soft

_AT_ONCE = 1.05  # times the smallest size: a cause that is separated by then never looks alike
_STILL_M = 1e-10  # largest movement of the markers by what moves nothing
_SHARE = 0.05  # of a cause's signal, above which a kind of effect takes part in imitating it


@dataclass(frozen=True, eq=False)
class Detectability(Detectable):
    """What a plan can see of one cause.

    moved : ndarray, shape (k,), m, RMS displacement of the markers by the smallest size
    reason : str, why it is hidden, empty if it is not
    """

    candidate: Candidate
    moved: Array
    reason: str

    @property
    def key(self) -> str:
        """``effect:where``."""
        return self.candidate.key

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Unknowns of the cause."""
        return self.candidate.amounts

    @property
    def sizes(self) -> Array:
        """Plausible sizes of the parameters, shape (k,), SI."""
        return np.array([p.size for p in self.parameters])

    @property
    def lead(self) -> int:
        """Position of the parameter whose smallest size is least beside what is plausible."""
        return int(np.argmin(self.smallest / self.sizes))


@dataclass(frozen=True, eq=False, repr=False)
class PowerAnalysis(Result):
    """What a plan can tell of the causes of the catalogue that a model lacks.

    model : Model; values : ndarray, shape (p,), SI, where it is linearised; assumed : bool, whether its
        compliances are taken as usual, for nobody gave them
    data : Measurements, the readings to come, their points predicted
    known : LinearProblem, of the model and all candidates, with these readings
    waiting : ndarray of bool, shape (m,), readings before the first move, which the diagnosis drops
    detection : CauseDetection, of the candidates; causes : what can be seen of each
    missing : tuple of NotAsked; asked : int, all that the diagnosis will ask, curves included
    lost : parameters of the model that the plan leaves open
    alike : Likeness, of the E causes that can be seen, None where there are none
    times : ndarray, shape (E, E), multiple of a cause's smallest size (row) from which on it is told
        from another (column); at most one where it always is once it is seen, infinite where never
    """

    model: Model
    values: Array
    assumed: bool
    data: Measurements
    known: LinearProblem
    waiting: Mask
    detection: CauseDetection
    causes: tuple[Detectability, ...]
    missing: tuple[NotAsked, ...]
    asked: int
    lost: tuple[Unidentifiable, ...]
    alike: Likeness | None
    times: Array

    @property
    def seen(self) -> tuple[Detectability, ...]:
        """Those that are detected where they are large enough, E of them."""
        return tuple(cause for cause in self.causes if not cause.reason)

    @property
    def hidden(self) -> tuple[Detectability, ...]:
        """The others."""
        return tuple(cause for cause in self.causes if cause.reason)

    def sentences(self) -> list[str]:
        return [
            f"Power analysis: {len(self.seen)} causes would be seen, {len(self.hidden)} would not"
        ]

    def rows(self) -> list[dict[str, object]]:
        return [
            {"cause": cause.key, "seen": not cause.reason, "reason": cause.reason}
            for cause in (*self.seen, *self.hidden)
        ]

    @property
    def confounded(self) -> tuple[tuple[int, ...], ...]:
        """Groups of causes, by position, that stand for each other at these poses at any size."""
        if self.alike is None:
            return ()
        groups = {tuple(np.flatnonzero(row).tolist()) for row in self.alike.confounded}
        return tuple(sorted(group for group in groups if len(group) > 1))

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Causes of just visible size and what they are taken for, the hardest to separate first."""
        pairs = [(int(i), int(j)) for i, j in np.argwhere(self.times > _AT_ONCE)]
        return sorted(pairs, key=lambda pair: -self.times[pair])


@one_blas_thread
def foresee(cell: Cell, plan: Plan, *, values: Array | None = None) -> PowerAnalysis:
    """Smallest sizes, hidden causes and look-alikes of a plan, before anything is measured.

    plan : poses, a plan's file or joint values; read free and loaded where the cell has a [load]. Of
        measurements the points are ignored
    values : ndarray, shape (p,), SI, where the model is linearised; nominal, and as soft as usual,
        without them

    A size is detected nine times in ten by the score test of the diagnosis, among all that it asks. A
    cause is told from another where the right one is preferred in 95 of 100 cases.

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, CalibError.
    """
    data = readings_of(cell, plan)
    model = build(cell, data.poses).model
    check_counts(model, data)
    assumed = values is None
    values = soft(model, data.poses) if values is None else values
    data = replace(data, readings=model.predict(values, data.poses))
    every, missing = candidates(cell, model, data)
    asked = [c for c in (_to_be_tried(c, data.poses) for c in every) if c.tried]
    named = tuple(c for c in asked if c.named)
    full, start = model.extended(values, [c.effect for c in named])
    whole = Linearisation(cell, full, start, Variances.of_arm(model.robot.dof, cell.repeatability))
    waiting = before_the_first_move(data.poses)
    known = whole.of(data, ~waiting).problem
    W, scatter = whole.weights(data, ~waiting), whole.scatter(data.poses)
    choice = choose_directions(Points(model, data, W, known=scatter), values)
    detection = CauseDetection.of(full, known.independent[1], choice.kept, named, len(asked))
    _, J = full.jacobian(start, data.poses)
    moved = np.sqrt((J[data.seen] ** 2).sum(axis=1).mean(axis=0))
    causes = tuple(
        _detectability(detection, model, data.poses, i, moved[full.amounts(c.effect)])
        for i, c in enumerate(named)
    )
    return PowerAnalysis(
        model, values, assumed, data, known, waiting, detection, causes, tuple(missing),
        len(asked), choice.unidentifiable, *detection.separated(),
    )  # fmt: skip


def _to_be_tried(candidate: Candidate, poses: Poses) -> Candidate:
    """A candidate with the number of values of its tuning that are tried at these poses."""
    effect = candidate.effect
    if not isinstance(effect, Tuned):
        return replace(candidate, tried=1)
    tried = len(effect.grid(poses))
    # What only a scan finds, such as a step, may lie after these readings where it usually does.
    usual = effect if effect.smooth or not tried else amid(effect, poses)
    return replace(candidate, effect=usual, tried=tried)


@dataclass(frozen=True, eq=False)
class CauseDetection:
    """The question which causes are detected beside all that is modelled, from which size on.

    causes : tuple of Candidate; columns : tuple of ndarray of int, of each in ``X``
    X, left : ndarray, shape (N, K), columns of all causes, and what is left of them beside the model
    modelled : ndarray, shape (N, p), columns of the model that are fitted; kinds : effect of each
    rows : int, that count; limits : tuple of Detectable, of each cause
    """

    causes: tuple[Candidate, ...]
    columns: tuple[IntArray, ...]
    X: Array
    left: Array
    modelled: Array
    kinds: tuple[str, ...]
    rows: int
    limits: tuple[Detectable, ...]

    @classmethod
    def of(
        cls, model: Model, rows: Array, kept: IntArray, causes: Sequence[Candidate], asked: int
    ) -> CauseDetection:
        """From independent rows (N, p) of all parameters.

        kept : ndarray of int, of what is modelled; asked : int, all causes that will be
        """
        at = [model.amounts(c.effect) for c in causes]
        columns = _parts([len(own) for own in at])
        X, N = rows[:, np.concatenate([kept[:0], *at])], rows[:, kept]
        Q = orthonormal(N)
        left = X - Q @ (Q.T @ X)
        lengths, count = np.linalg.norm(X, axis=0), int(np.count_nonzero(rows.any(axis=1)))
        limits = tuple(
            detectable(left[:, at].T @ left[:, at], lengths[at], asked * cause.choices, ALPHA)
            for at, cause in zip(columns, causes, strict=True)
        )
        kinds = tuple(model.parameters[i].effect for i in kept)
        return cls(tuple(causes), columns, X, left, N, kinds, count, limits)

    def separated(self) -> tuple[Likeness | None, Array]:
        """How alike those that can be seen are, and ``times`` of them, shape (E, E)."""
        seen = [i for i, limit in enumerate(self.limits) if limit.directions]
        if not seen:
            return None, np.zeros((0, 0))
        at = np.concatenate([self.columns[i] for i in seen])
        X, columns = self.left[:, at], _parts([len(self.columns[i]) for i in seen])
        signals = [plausible(np.array([p.size for p in self.causes[i].amounts])) for i in seen]
        alike = likeness(X.T @ X, np.linalg.norm(self.X[:, at], axis=0), columns, signals)
        needed = np.array([self.limits[i].needed for i in seen])
        times: Array = np.sqrt(alike.needed(self.rows) / needed[:, None])
        np.fill_diagonal(times, 0.0)
        return alike, times

    def imitators(self, position: int, sizes: Array) -> list[str]:
        """Kinds of modelled effect that together move the markers as a cause of these sizes does."""
        signal = self.X[:, self.columns[position]] * sizes
        scale = np.maximum(np.linalg.norm(self.modelled, axis=0), 1e-300)
        share = np.linalg.lstsq(self.modelled / scale, signal, rcond=None)[0] / scale[:, None]
        parts = {
            kind: np.linalg.norm(self.modelled[:, own] @ share[own])
            for kind in dict.fromkeys(self.kinds)
            if (own := [k == kind for k in self.kinds])
        }
        return [kind for kind, part in parts.items() if part > _SHARE * np.linalg.norm(signal)]


def _parts(lengths: Sequence[int]) -> tuple[IntArray, ...]:
    """Positions of parts of these lengths, one after another."""
    return tuple(np.arange(a, b) for a, b in pairwise(np.cumsum([0, *lengths])))


def _detectability(
    detection: CauseDetection, model: Model, poses: Poses, position: int, moved: Array
) -> Detectability:
    """What can be seen of one candidate; moved : ndarray, shape (k,), m per SI unit, of the markers."""
    candidate, limit = detection.causes[position], detection.limits[position]
    sizes, reason = np.array([p.size for p in candidate.amounts]), ""
    if not limit.directions and (moved * sizes).max() < _STILL_M:
        reason = _why_still(candidate.effect, model, poses)
    elif not limit.directions:
        kinds = detection.imitators(position, sizes)
        together = f"{', '.join(kinds[:-1])} and {kinds[-1]} together move" if kinds[1:] else ""
        reason = f"{together or f'{kinds[0]} moves'} the markers in the same way"
    finite = np.isfinite(limit.smallest)
    shift = np.where(finite, np.where(finite, limit.smallest, 0.0) * moved, np.inf)
    return Detectability(**vars(limit), candidate=candidate, moved=shift, reason=reason)


def _why_still(effect: Effect, model: Model, poses: Poses) -> str:
    """Why a cause moves nothing."""
    if effect.uses:
        return f"{' and '.join(effect.uses)} never changes at these poses"
    if isinstance(effect, LoadEffect) and not len(model.where(ElasticEffect)):
        return "nothing in the model is elastic"
    if not isinstance(effect, ElasticEffect | LoadEffect):
        return "no reading changes with it at these poses"
    if loads_of(model.robot, poses, model.payload, model.gravity).absent:
        return "nothing loads the arm"
    elastic = isinstance(effect, ElasticEffect)
    return "no load acts on it at these poses" if elastic else "nothing elastic feels it"
