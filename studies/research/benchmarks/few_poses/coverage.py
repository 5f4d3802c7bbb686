"""Whether what an identification says of itself holds, over one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import calib
from calib.arrays import Array, Mask
from calib.model.build import build
from calib.poses import Poses, poses_at
from calib.uncertainty.budget import accuracy_at_targets
from calib.uncertainty.expanded import coverage_factor, effective_freedom
from studies.research.benchmarks.few_poses.files import table_of
from studies.research.benchmarks.few_poses.ridge import exact_values
from studies.research.benchmarks.few_poses.truth import Day
from studies.research.withheld.figures import wilson

POINTS = 50  # held-out poses at which points count
_LARGEST_RESIDUAL = 1e-9  # m, of exact readings
_NORMAL = 1.96


@dataclass(frozen=True)
class Held:
    """How many of so many intervals hold what is true."""

    held: int
    of: int


@dataclass(frozen=True)
class Kept:
    """What became of the claims of one identification.

    parameters, points : 95 % intervals; normal : of points with 1.96 in place of the product's factor
    targets : poses whose RMS error is within the product's 95 % bound for them; whole : whether the RMS
        over the targets is within the RMS of these bounds
    promised, came : m, RMS error expected at the targets, and what it is
    outliers : poses that were left out; none of a day deserves it
    std : m, RMS over the points of what the covariance has a point err by; off : what it errs by
    """

    parameters: Held
    points: Held
    normal: Held
    targets: Held
    whole: Held
    outliers: int
    promised: float
    came: float
    std: float
    off: float


def true_values(cell: calib.Cell, day: Day) -> Array:
    """What the model's parameters are of this arm, shape (p,), SI, by exact readings of other poses.

    Raises RuntimeError where the model cannot stand for the arm.
    """
    exact = table_of(day.held, day.points(day.held))
    values, left = exact_values(build(cell, exact.poses).model, exact)
    if left > _LARGEST_RESIDUAL:
        raise RuntimeError(f"exact readings leave {left} m: no truth to measure against")
    return values


def kept(cell: calib.Cell, found: calib.Identification, truth: Array, day: Day) -> Kept:
    """Hold the claims against the truth (p,)."""
    low, high = found.interval().T
    estimated = np.diag(found.covariance) > 0.0
    holds = ((low <= truth) & (truth <= high))[estimated]
    poses = poses_at(day.held[:POINTS])
    off = found.predict(poses) - day.points(poses.q)
    std, factor = _at_points(found, poses)
    claim = accuracy_at_targets(cell, found)
    errors = _lengths(found.predict(claim.targets) - day.points(claim.targets.q))
    expected = claim.expected
    came = claim.rms(errors)
    return Kept(
        parameters=_held(holds),
        points=_held(np.abs(off) <= factor * std),
        normal=_held(np.abs(off) <= _NORMAL * std),
        targets=_held(errors <= expected.expanded),
        whole=_held(np.array([came <= claim.rms(expected.expanded)])),
        outliers=int(np.count_nonzero(found.fit.outlier)),
        promised=claim.rms(expected.errors),
        came=came,
        std=float(np.sqrt((std**2).sum(axis=-1).mean())),
        off=float(np.sqrt((off**2).sum(axis=-1).mean())),
    )


def share(own: Sequence[Held]) -> tuple[float, float, float]:
    """Share that holds over days, and its 95 % interval (Wilson).

    Errors of a day go together: the count is divided by how much wider days scatter than so many
    independent intervals would, and of days that all hold everything each counts once.

    >>> share([Held(9, 10), Held(10, 10), Held(9, 10), Held(10, 10)])[0]
    0.95
    >>> share([Held(10, 10)] * 20) == share([Held(1, 1)] * 20)
    True
    """
    hits, of = (np.array([getattr(h, name) for h in own]) for name in ("held", "of"))
    total, rate = int(of.sum()), float(hits.sum() / of.sum())
    worth = float(len(own))
    if 0.0 < rate < 1.0 and len(own) > 1:
        scatter = float(((hits - rate * of) ** 2).sum()) * len(own) / (len(own) - 1)
        worth = min(float(total), total**2 * rate * (1.0 - rate) / max(scatter, 1e-9))
    count = max(1, round(worth))
    return rate, *wilson(round(rate * count), count)


def _at_points(found: calib.Identification, poses: Poses) -> tuple[Array, Array]:
    """Standard deviation of each coordinate (m, M, 3), m, and what it is multiplied by for 95 %."""
    _, J = found.model.jacobian(found.values, poses)
    parts = [
        (np.einsum("...p,pq,...q->...", J, cov, J, optimize=True), freedom)
        for cov, freedom in ((found.covariance, found.freedom), (found.ignorance, np.inf))
    ]
    std = np.sqrt(np.maximum(sum(own for own, _ in parts), 0.0))
    return np.asarray(std), coverage_factor(effective_freedom(parts))


def _lengths(off: Array) -> Array:
    """RMS over the points of each pose, shape (m,), m."""
    return np.asarray(np.sqrt((off**2).sum(axis=-1).mean(axis=-1)))


def _held(holds: Mask) -> Held:
    return Held(int(np.count_nonzero(holds)), int(holds.size))
