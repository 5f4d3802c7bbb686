"""What a plan promises: standard deviations, accuracy at the targets, and what it stands to lose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from doe.constraints import read_by, scene_of, visible
from doe.problem import RIDGE, Problem

_NOTHING = 1e3 * RIDGE  # eigenvalue of the information below which a direction is open


@dataclass(frozen=True, eq=False)
class Assessment:
    """A plan judged by its information matrix, before anything is measured.

    value : float, the problem's criterion, as shown
    determinant, trace : float, det(M)^(1/p) and the trace of the covariance, parameters in their units
    std : ndarray, shape (p,), SI, NaN where the plan leaves a parameter open
    task_rms, task_worst : float, m, over the target poses
    observability : dict, indices O1 to O5 of rows scaled to plausible sizes
    points, hidden : int, points of the plan, and how many of them are out of sight
    """

    value: float
    determinant: float
    trace: float
    std: Array
    task_rms: float
    task_worst: float
    observability: dict[str, float]
    points: int
    hidden: int


def assess(problem: Problem, q: Array) -> Assessment:
    """Judge the poses of a plan (m, dof) together with those that are measured in any case."""
    M = problem.fixed + problem.information(q).sum(axis=0)
    units = np.array([p.scale for p in problem.model.parameters])
    shown = problem.regressor.T / units[:, None]
    cov = shown @ np.linalg.solve(M, shown.T)
    lost = open_parameters(problem, M)
    rows, weights = problem.at_targets.rows, problem.at_targets.weights
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
        observability=observability(problem, M, len(q)),
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


def observability(problem: Problem, M: Array, poses: int) -> dict[str, float]:
    """Observability indices of the rows behind M, shape (p, p), columns in plausible sizes.

    O1 Borm and Menq 1991; O2 Driels and Pathre 1990; O3 Nahvi, Hollerbach and Hayward 1994; O4 Nahvi
    and Hollerbach 1996; O5 Sun and Hollerbach 2008. O2 to O5 depend on the scaling, O1 by a factor.
    """
    sized = problem.regressor.T / problem.model.sizes[:, None]
    half = np.linalg.solve(np.linalg.cholesky(M), sized.T)  # its squares would lose the smallest
    s = 1.0 / np.linalg.svd(half, compute_uv=False)
    least, most = float(s.min()), float(s.max())
    mean = float(np.exp(np.log(s).mean()) / np.sqrt(poses))
    indices = (mean, least / most, least, least**2 / most, float(1.0 / (1.0 / s).sum()))
    return {f"O{k}": index for k, index in enumerate(indices, 1)}
