"""A plan: the poses, how good they are, and the proof of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib.arrays import Array, Mask
from calib.poses import Poses, poses_at
from calib.result import Result
from doe.constraints import read_by, scene_of, visible
from doe.levels import AngleLevels
from doe.order import Reapproaches
from doe.problem import RIDGE, Problem

_NOTHING = 1e3 * RIDGE  # eigenvalue of the information below which a direction is open


@dataclass(frozen=True, eq=False)
class Assessment:
    """A plan judged by its information matrix, before anything is measured.

    value : float, the problem's criterion, as shown
    determinant, trace : float, det(M)^(1/p) and the trace of the covariance, parameters in their units
    std : ndarray, shape (p,), SI, NaN where the plan leaves a parameter open
    task_rms, task_worst : float, m, over the target poses
    points, hidden : int, points of the plan, and how many of them are out of sight
    """

    value: float
    determinant: float
    trace: float
    std: Array
    task_rms: float
    task_worst: float
    points: int
    hidden: int


@dataclass(frozen=True, eq=False)
class Certificate:
    """The proof, as information functions: the larger the better. Second visits count.

    value : float, criterion of the plan
    bound : float, no plan of the candidates and of the plan's own poses is better, with as many
        second visits or with other poses in their place
    """

    value: float
    bound: float

    @property
    def efficiency(self) -> float:
        """At least this fraction of the best that any allowed plan could reach."""
        return min(1.0, self.value / self.bound)


@dataclass(frozen=True)
class CurveStep:
    """The best plan found of so many poses.

    poses : int; value : float, criterion as shown; task_rms : float, m; efficiency : float
    """

    poses: int
    value: float
    task_rms: float
    efficiency: float


@dataclass(frozen=True, eq=False)
class Rival:
    """A plan of so many poses that was judged beside the result, against the same bound."""

    poses: int
    assessment: Assessment
    efficiency: float


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result):
    """The result of :func:`doe.design`.

    problem : Problem
    poses : Poses, in the order of measuring, second visits included
    levels : AngleLevels, settled, or None
    assessment : Assessment; certificate : Certificate
    rivals : dict, name -> Rival
    curve : tuple of CurveStep, plans of fewer and more poses, empty unless asked for
    notes : tuple of str, what a reader should know
    granted : tuple of str, what the expected error takes for granted
    seconds : float, that it took
    reapproaches : Reapproaches or None
    duration : float, s, of the day in this order, NaN where not all speeds are known
    """

    problem: Problem
    poses: Poses
    levels: AngleLevels | None
    assessment: Assessment
    certificate: Certificate
    duration: float
    rivals: dict[str, Rival] = field(default_factory=dict)
    curve: tuple[CurveStep, ...] = ()
    notes: tuple[str, ...] = ()
    granted: tuple[str, ...] = ()
    seconds: float = 0.0
    reapproaches: Reapproaches | None = None

    def sentences(self) -> list[str]:
        return [
            f"Design: {len(self.poses)} poses, criterion {self.criterion} {self.value:.4g}",
            f"at least {self.efficiency:.1%} of the best that any plan of these candidates reaches",
            *self.notes,
        ]

    def rows(self) -> list[dict[str, object]]:
        robot = self.problem.cell.robot
        return [
            {"pose": name, **robot.shown(q)}
            for name, q in zip(self.poses.names, self.poses.q, strict=True)
        ]

    @property
    def level(self) -> Array:
        """Level at which each pose stands, rad or m, NaN without levels, shape (N,)."""
        q, levels = self.poses.q, self.levels
        return np.full(len(q), np.nan) if levels is None else q[:, levels.joint]

    @property
    def criterion(self) -> str:
        """Name of the criterion."""
        return self.problem.criterion.name

    @property
    def value(self) -> float:
        """The criterion as it is shown."""
        return self.problem.criterion.shown(self.certificate.value)

    @property
    def bound(self) -> float:
        """What no allowed plan surpasses, as the criterion is shown."""
        return self.problem.criterion.shown(self.certificate.bound)

    @property
    def efficiency(self) -> float:
        """At least this fraction of the best that any allowed plan could reach."""
        return self.certificate.efficiency


def named(q: Array) -> Poses:
    """Poses p01, p02 .. at joint values (N, dof)."""
    width = max(2, len(str(len(q))))
    return poses_at(q, names=tuple(f"p{i + 1:0{width}d}" for i in range(len(q))))


def assess(problem: Problem, q: Array) -> Assessment:
    """Judge the poses of a plan (m, dof) together with those that are measured in any case."""
    M = problem.fixed + problem.information(q).sum(axis=0)
    units = np.array([p.scale for p in problem.model.parameters])
    shown = problem.regressor.T / units[:, None]
    cov = shown @ np.linalg.solve(M, shown.T)
    lost = open_parameters(problem, M)
    rows, weights = problem.target_rows, problem.target_weights
    squared = _squared_errors(rows, M)
    scene = scene_of(problem.cell, q)
    seen, asked = visible(scene), read_by(scene)
    return Assessment(
        value=problem.criterion.shown(float(problem.criterion.plain.value(M))),
        determinant=0.0 if lost.any() else float(np.exp(-np.linalg.slogdet(cov)[1] / len(cov))),
        trace=np.inf if lost.any() else float(np.trace(cov)),
        std=np.where(lost, np.nan, np.sqrt(np.diag(cov)) * units),
        task_rms=_rms(weights, squared),
        task_worst=float(np.sqrt(squared[weights > 0.0].max())),
        points=int(asked.sum()),
        hidden=int((asked & ~seen).sum()),
    )


def open_parameters(problem: Problem, M: Array) -> Mask:
    """Parameters that a plan's information leaves open, shape (p,)."""
    values, vectors = np.linalg.eigh(M)
    sized = problem.regressor.T / problem.model.sizes[:, None]
    lost = np.linalg.norm(sized @ vectors[:, values < _NOTHING], axis=1)
    return np.asarray(lost > 1e-3 * np.linalg.norm(sized, axis=1))


def _squared_errors(rows: Array, M: Array) -> Array:
    """Expected squared error at each target, shape (K,), m^2; inf where an open direction shows.

    rows : ndarray, shape (K, r, p), of the targets
    """
    values, vectors = np.linalg.eigh(M)
    along = rows @ vectors
    squared = (along**2 / np.maximum(values, 0.1 * RIDGE)).sum(axis=(1, 2))
    lost = along[..., values < _NOTHING]
    shows = np.linalg.norm(lost, axis=(1, 2)) > 1e-6 * np.linalg.norm(rows, axis=(1, 2))
    return np.where(shows, np.inf, squared)


def _rms(weights: Array, squared: Array) -> float:
    """Over the targets, m; inf where it is so at one, whatever it weighs."""
    return float(np.sqrt(squared @ weights)) if np.isfinite(squared).all() else np.inf
