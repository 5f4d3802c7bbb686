"""What a plan can tell of causes that no model has yet, before anything is measured.

The plan is seen as the diagnosis will see it: every cause beside everything modelled, and no residual
yet. Of each cause the size that is found, or why none is; of each two whether they are told apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
from calib.inference.evidence import visible_directions
from calib.linear import LinearProblem, orthonormal
from calib.model import Model
from calib.model.build import build
from calib.model.covariance import Unidentifiable
from calib.observations import Points
from calib.poses import Measurements
from calib.poses.moves import before_the_first_move
from calib.result import Result
from calib.scatter import Variances
from calib.threads import one_blas_thread
from doe.forecast.coming import readings_of
from doe.forecast.likeness import Likeness, likeness, plausible
from doe.information import Linearisation, soft

_AT_ONCE = 1.05  # times the smallest size: who is told apart by then never looks alike


@dataclass(frozen=True, eq=False, repr=False)
class PowerAnalysis(Result):
    """What a plan can tell of the causes of the catalogue that a model lacks.

    model : Model; values : ndarray, shape (p,), SI, where it is linearised; assumed : bool, whether its
        compliances are taken as usual, for nobody gave them
    data : Measurements, the readings to come, their points predicted
    known : LinearProblem, of the model and all suspects, with these readings
    waiting : ndarray of bool, shape (m,), readings before the first move, which the diagnosis drops
    detection : CauseDetection, of the suspects, by name; missing : tuple of NotAsked
    asked : int, all that the diagnosis will ask, curves included
    kept : ndarray of int, columns of what is modelled; lost : what the plan leaves open
    moved : ndarray, shape (columns,), m per SI unit, RMS displacement of the markers
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
    missing: tuple[NotAsked, ...]
    asked: int
    kept: IntArray
    lost: tuple[Unidentifiable, ...]
    moved: Array
    alike: Likeness | None
    times: Array

    @cached_property
    def causes(self) -> tuple[Detectability, ...]:
        """What can be seen of every suspect."""
        return tuple(_detectability(self, i) for i in range(len(self.detection.causes)))

    @property
    def seen(self) -> tuple[Detectability, ...]:
        """Those that are found where they are large enough, E of them."""
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
            {"cause": own.key, "seen": not own.reason, "reason": own.reason}
            for own in (*self.seen, *self.hidden)
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
        """Causes of just visible size and what they are taken for, the hardest to tell first."""
        found = [(int(i), int(j)) for i, j in np.argwhere(self.times > _AT_ONCE)]
        return sorted(found, key=lambda pair: -self.times[pair])


@one_blas_thread
def foresee(cell: Cell, plan: Plan, *, values: Array | None = None) -> PowerAnalysis:
    """Smallest sizes, hidden causes and look-alikes of a plan, before anything is measured.

    plan : poses, a plan's file or joint values; read free and loaded where the cell has a [load]. Of
        measurements the points are ignored
    values : ndarray, shape (p,), SI, where the model is linearised; nominal, and as soft as usual,
        without them

    A size is found nine times in ten by the score test of the diagnosis, among all that it asks. A
    cause is told from another where the right one is preferred in 95 of 100 cases.

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, CalibError.
    """
    data = readings_of(cell, plan)
    model = build(cell, data.poses).model
    check_counts(model, data)
    assumed = values is None
    values = soft(model, data.poses) if values is None else values
    data = replace(data, readings=model.predict(values, data.poses))
    everything, missing = candidates(cell, model, data)
    # So many values of a tuning are tried at these poses, none where they tell nothing of it.
    tried = [
        len(c.effect.grid(data.poses)) if isinstance(c.effect, Tuned) else 1 for c in everything
    ]
    everything = [replace(c, tried=n) for c, n in zip(everything, tried, strict=True) if n]
    # What only a scan finds, such as a step, may lie after these readings where it usually does.
    scanned = (isinstance(c.effect, Tuned) and not c.effect.smooth for c in everything)
    everything = [
        replace(c, effect=amid(c.effect, data.poses)) if own else c
        for c, own in zip(everything, scanned, strict=True)
    ]
    suspects = tuple(c for c in everything if c.named)
    full, start = model.extended(values, [c.effect for c in suspects])
    arm = Variances.of_arm(model.robot.dof, cell.repeatability)
    whole = Linearisation(cell, full, start, arm)
    waiting = before_the_first_move(data.poses)
    known = whole.of(data, ~waiting).problem
    own = Points(model, data, whole.weights(data, ~waiting), known=whole.scatter(data.poses))
    choice = choose_directions(own, values)
    asked, rows = len(everything), known.independent[1]
    detection = CauseDetection.of(full, rows, choice.kept, suspects, asked)
    _, J = full.jacobian(start, data.poses)
    added = np.setdiff1d(np.arange(len(values), len(start)), full.tunings)
    moved = np.sqrt((J[data.seen][..., added] ** 2).sum(axis=1).mean(axis=0))
    return PowerAnalysis(
        model, values, assumed, data, known, waiting, detection, tuple(missing), asked,
        choice.kept, choice.unidentifiable, moved, *detection.told_apart(),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class CauseDetection:
    """The question which causes are found beside all that is modelled, from which size on.

    causes : tuple of Candidate; columns : tuple of ndarray of int, of each in ``X``
    X, left : ndarray, shape (N, K), columns of all causes, and what is left of them beside the model
    rows : int, that count; limits : tuple of Detectable, of each cause
    """

    causes: tuple[Candidate, ...]
    columns: tuple[IntArray, ...]
    X: Array
    left: Array
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
        ends = np.cumsum([0, *map(len, at)])
        columns = tuple(np.arange(a, b) for a, b in pairwise(ends))
        X = rows[:, np.concatenate([kept[:0], *at])]
        left = beside(rows[:, kept], X)
        lengths, count = np.linalg.norm(X, axis=0), int(np.count_nonzero(rows.any(axis=1)))
        limits = tuple(
            detectable(left[:, at].T @ left[:, at], lengths[at], asked * cause.choices, ALPHA)
            for at, cause in zip(columns, causes, strict=True)
        )
        return cls(tuple(causes), columns, X, left, count, limits)

    def told_apart(self) -> tuple[Likeness | None, Array]:
        """How alike those that can be seen are, and ``times`` of them, shape (E, E)."""
        seen = [i for i, limit in enumerate(self.limits) if limit.directions]
        if not seen:
            return None, np.zeros((0, 0))
        at = np.concatenate([self.columns[i] for i in seen])
        X, ends = self.left[:, at], np.cumsum([0, *(len(self.columns[i]) for i in seen)])
        own = [np.arange(a, b) for a, b in pairwise(ends)]
        signals = [plausible(np.array([p.size for p in self.causes[i].amounts])) for i in seen]
        alike = likeness(X.T @ X, np.linalg.norm(self.X[:, at], axis=0), own, signals)
        needed = np.array([self.limits[i].needed for i in seen])
        times: Array = np.sqrt(alike.needed(self.rows) / needed[:, None])
        np.fill_diagonal(times, 0.0)
        return alike, times


def beside(N: Array, X: Array) -> Array:
    """Columns X (rows, K) with all of N (rows, p) projected out."""
    Q = orthonormal(N)
    return np.asarray(X - Q @ (Q.T @ X))


_STILL_M = 1e-10  # largest movement of the markers by what moves nothing


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


def _detectability(found: PowerAnalysis, position: int) -> Detectability:
    """What can be seen of one suspect."""
    candidate, columns = found.detection.causes[position], found.detection.columns[position]
    seen = found.detection.limits[position]
    moved, finite = np.full(len(columns), np.inf), np.isfinite(seen.smallest)
    moved[finite] = seen.smallest[finite] * found.moved[columns][finite]
    reason = "" if seen.directions else _why_hidden(found, position)
    return Detectability(**vars(seen), candidate=candidate, moved=moved, reason=reason)


def _why_hidden(found: PowerAnalysis, position: int) -> str:
    """It moves nothing, or what the model has moves the markers alike."""
    effect, columns = found.detection.causes[position].effect, found.detection.columns[position]
    sizes = np.array([p.size for p in found.detection.causes[position].amounts])
    if (found.moved[columns] * sizes).max() < _STILL_M:
        return _why_still(effect, found)
    kinds = _imitators(found, position)
    together = f"{', '.join(kinds[:-1])} and {kinds[-1]} together" if len(kinds) > 1 else kinds[0]
    return f"{together} {'move' if len(kinds) > 1 else 'moves'} the markers in the same way"


def _why_still(effect: Effect, found: PowerAnalysis) -> str:
    if effect.uses:
        return f"{' and '.join(effect.uses)} never changes at these poses"
    model, poses = found.model, found.data.poses
    if isinstance(effect, LoadEffect) and not len(model.where(ElasticEffect)):
        return "nothing in the model is elastic"
    if not isinstance(effect, ElasticEffect | LoadEffect):
        return "no reading changes with it at these poses"
    if loads_of(model.robot, poses, model.payload, model.gravity).absent:
        return "nothing loads the arm"
    elastic = isinstance(effect, ElasticEffect)
    return "no load acts on it at these poses" if elastic else "nothing elastic feels it"


def _imitators(found: PowerAnalysis, position: int) -> list[str]:
    """Kinds of modelled effect without which the cause would be seen, else all."""
    own = [found.model.parameters[i].effect for i in found.kept]
    kinds, columns = list(dict.fromkeys(own)), found.detection.columns[position]
    N = found.known.independent[1][:, found.kept]
    X = found.detection.X[:, columns]
    lengths = np.linalg.norm(X, axis=0)
    needed = []
    for kind in kinds:
        others = N[:, [k != kind for k in own]]
        left = beside(others, X)
        if visible_directions(left.T @ left, lengths)[1].any():
            needed.append(kind)
    return needed or kinds
