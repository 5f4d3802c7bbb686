"""What a plan can tell of causes that no model has yet, before anything is measured.

The plan is seen as the diagnosis will see it: every cause beside everything modelled, and no residual
yet. Of each cause the size that is detected, or why none is. Of each two, how much of the one the other
imitates: a cause of noncentrality lambda leaves ``lambda (1 - rho^2)`` beside another that is fitted
(Atkinson and Fedorov, Biometrika 62(1), 1975), so it is told from it ``1 / sqrt(1 - rho^2)`` times
larger.
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
from calib.inference.evidence import VISIBLE, visible_directions
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import Unidentifiable
from calib.observations import Points
from calib.observations.linear import orthonormal
from calib.observations.scatter import Variances
from calib.poses import Measurements, Poses
from calib.poses.moves import before_the_first_move
from calib.result import Result
from calib.threads import one_blas_thread
from doe.forecast.coming import readings_of
from doe.information import Linearisation, soft

_ALIKE = 2.0  # times the smallest size: causes that are told apart by then do not look alike
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
    def lead(self) -> int:
        """Position of the parameter whose smallest size is least beside what is plausible."""
        return int(np.argmin(self.smallest / _sizes(self.candidate)))


@dataclass(frozen=True, eq=False, repr=False)
class PowerAnalysis(Result):
    """What a plan can tell of the causes of the catalogue that a model lacks.

    model : Model; values : ndarray, shape (p,), SI, where it is linearised; assumed : bool, whether its
        compliances are taken as usual, for nobody gave them
    data : Measurements, the readings to come, their points predicted
    waiting : ndarray of bool, shape (m,), readings before the first move, which the diagnosis drops
    causes : what can be seen of each candidate; beside : Beside, their columns
    missing : tuple of NotAsked; asked : int, all that the diagnosis will ask, curves included
    lost : parameters of the model that the plan leaves open
    rho : ndarray, shape (E, E), share of the signal of each of the E causes that can be seen (row), of
        plausible parameters, that another (column) imitates; rho_worst : of the direction imitated best
    """

    model: Model
    values: Array
    assumed: bool
    data: Measurements
    waiting: Mask
    causes: tuple[Detectability, ...]
    beside: Beside
    missing: tuple[NotAsked, ...]
    asked: int
    lost: tuple[Unidentifiable, ...]
    rho: Array
    rho_worst: Array

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
    def times(self) -> Array:
        """Multiple of a cause's smallest size (row) that is found beside another (column), (E, E)."""
        left = np.sqrt(np.maximum(1.0 - self.rho**2, 0.0))
        return np.where(left > VISIBLE, 1.0 / np.maximum(left, VISIBLE), np.inf)

    @property
    def confounded(self) -> tuple[tuple[int, ...], ...]:
        """Groups of causes, by position, that stand for each other at these poses at any size."""
        never = np.isinf(self.times) | np.eye(len(self.rho), dtype=bool)
        groups = {tuple(np.flatnonzero(row).tolist()) for row in never & never.T}
        return tuple(sorted(group for group in groups if len(group) > 1))

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Causes and what they are taken for, the hardest to separate first."""
        pairs = [(int(i), int(j)) for i, j in np.argwhere(self.times > _ALIKE) if i != j]
        return sorted(pairs, key=lambda pair: -self.times[pair])


@one_blas_thread
def foresee(cell: Cell, plan: Plan, *, values: Array | None = None) -> PowerAnalysis:
    """Smallest sizes, hidden causes and look-alikes of a plan, before anything is measured.

    plan : poses, a plan's file or joint values; read free and loaded where the cell has a [load]. Of
        measurements the points are ignored
    values : ndarray, shape (p,), SI, where the model is linearised; nominal, and as soft as usual,
        without them

    A size is detected nine times in ten by the score test of the diagnosis, among all that it asks.

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, CalibError.
    """
    data = readings_of(cell, plan)
    model = build(cell, data.poses).model
    check_counts(model, data)
    assumed = values is None
    values = soft(model, data.poses) if values is None else values
    data = replace(data, readings=model.predict(values, data.poses))
    every, missing = candidates(cell, model, data)
    tried = [c for c in (_to_be_tried(c, data.poses) for c in every) if c.tried]
    named = tuple(c for c in tried if c.named)
    full, start = model.extended(values, [c.effect for c in named])
    whole = Linearisation(cell, full, start, Variances.of_arm(model.robot.dof, cell.repeatability))
    waiting = before_the_first_move(data.poses)
    rows = whole.of(data, ~waiting).problem.independent[1]
    W, scatter = whole.weights(data, ~waiting), whole.scatter(data.poses)
    choice = choose_directions(Points(model, data, W, known=scatter), values)
    beside = Beside.of(rows, choice.kept, [full.amounts(c.effect) for c in named])
    _, J = full.jacobian(start, data.poses)
    moved = np.sqrt((J[data.seen] ** 2).sum(axis=1).mean(axis=0))
    causes = tuple(
        _detectability(beside, model, data.poses, i, c, moved[full.amounts(c.effect)], len(tried))
        for i, c in enumerate(named)
    )
    return PowerAnalysis(
        model, values, assumed, data, waiting, causes, beside, tuple(missing), len(tried),
        choice.unidentifiable, *beside.imitated(causes),
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


def _sizes(candidate: Candidate) -> Array:
    """Plausible sizes of its parameters, shape (k,), SI."""
    return np.array([p.size for p in candidate.amounts])


@dataclass(frozen=True, eq=False)
class Beside:
    """Columns of all causes beside all that is modelled, in independent rows N.

    columns : tuple of ndarray of int, of each cause in ``X``
    X, left : ndarray, shape (N, K), all of them, and what is left of them beside the model
    modelled : ndarray, shape (N, p), columns of the model that are fitted; kept : ndarray, which
    """

    columns: tuple[IntArray, ...]
    X: Array
    left: Array
    modelled: Array
    kept: IntArray

    @classmethod
    def of(cls, rows: Array, kept: IntArray, at: Sequence[IntArray]) -> Beside:
        """From independent rows (N, p) of all parameters; kept, at : of the model, of each cause."""
        ends = np.cumsum([0, *map(len, at)])
        columns = tuple(np.arange(a, b) for a, b in pairwise(ends))
        X, modelled = rows[:, np.concatenate([kept[:0], *at])], rows[:, kept]
        Q = orthonormal(modelled)
        return cls(columns, X, X - Q @ (Q.T @ X), modelled, kept)

    def imitated(self, causes: Sequence[Detectability]) -> tuple[Array, Array]:
        """``rho`` and ``rho_worst`` of the causes that can be seen, shape (E, E)."""
        bases, signals = list[Array](), list[Array]()
        for own, cause in zip(self.columns, causes, strict=True):
            if not cause.reason:
                X = self.left[:, own]
                U, seen = visible_directions(X.T @ X, np.linalg.norm(self.X[:, own], axis=0))
                bases.append(X @ U[:, seen])
                signals.append(bases[-1].T @ X * _sizes(cause.candidate))
        rho, worst = np.zeros((2, len(bases), len(bases)))
        for i, (U, signal) in enumerate(zip(bases, signals, strict=True)):
            crossed = [V.T @ U for V in bases]
            rho[i] = [np.linalg.norm(C @ signal) / np.linalg.norm(signal) for C in crossed]
            worst[i] = [np.linalg.norm(C, 2) for C in crossed]
        return np.minimum(rho, 1.0), np.minimum(worst, 1.0)

    def imitators(self, model: Model, position: int, sizes: Array) -> list[str]:
        """Kinds of modelled effect that together move the markers as a cause of these sizes does."""
        signal = self.X[:, self.columns[position]] * sizes
        scale = np.maximum(np.linalg.norm(self.modelled, axis=0), 1e-300)
        share = np.linalg.lstsq(self.modelled / scale, signal, rcond=None)[0] / scale[:, None]
        kinds = np.array([model.parameters[i].effect for i in self.kept])
        least = _SHARE * np.linalg.norm(signal)
        return [
            kind
            for kind in dict.fromkeys(kinds.tolist())
            if np.linalg.norm(self.modelled[:, kinds == kind] @ share[kinds == kind]) > least
        ]


def _detectability(
    beside: Beside, model: Model, poses: Poses, position: int, candidate: Candidate, moved: Array,
    asked: int,
) -> Detectability:  # fmt: skip
    """What can be seen of one candidate of so many that are asked.

    moved : ndarray, shape (k,), m per SI unit, of the markers
    """
    own, sizes, reason = beside.columns[position], _sizes(candidate), ""
    X, lengths = beside.left[:, own], np.linalg.norm(beside.X[:, own], axis=0)
    limit = detectable(X.T @ X, lengths, asked * candidate.choices, ALPHA)
    if not limit.directions and (moved * sizes).max() < _STILL_M:
        reason = _why_still(candidate.effect, model, poses)
    elif not limit.directions:
        kinds = beside.imitators(model, position, sizes)
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
