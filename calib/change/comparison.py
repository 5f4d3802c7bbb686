"""What changed on a robot between two results, what that does, why, and whether it still holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.change.causes import (
    ChangeCause,
    Explanation,
    candidates,
    explanations,
    same_as,
    shown_otherwise,
)
from calib.change.difference import Difference, difference
from calib.change.known import DayEstimate
from calib.compensation.estimate import Estimate
from calib.compensation.unexplained import scatter_at
from calib.effects.protocol import Parameter
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import context_of
from calib.model.covariance import working_points
from calib.model.reduction import generic_configurations
from calib.poses import Poses, poses_at
from calib.uncertainty.expanded import Interval, freedom, lengths

_LIMIT = 1.96  # standard deviations of the difference of two mean squares, 97.5 % from above
Told: TypeAlias = Literal["none", "named", "ambiguous", "unclear"]

_GENERIC = 100
_NAMED = 0.5  # probability of the likeliest cause from which on it stands alone


@dataclass(frozen=True, eq=False)
class Changes:
    """Result of :func:`changes`.

    difference : Difference; parameters : tuple of Parameter, those that are compared, in its order
    explanations : tuple of Explanation, of every cause asked, the likeliest first
    targets : Poses; change : AtTargets, what lies between the true robots of both days
    kept : AtTargets, what the earlier values err by on the later day's robot
    renewed : float, m, RMS that the later values leave by their uncertainty, 3-D per point
    outside : float or None, m, RMS that may have come up outside the model, its upper limit
    rest : float, m, RMS beside both: what the model lacks, and how the arm scatters
    tolerance : float or None, m
    """

    difference: Difference
    parameters: tuple[Parameter, ...]
    explanations: tuple[Explanation, ...]
    targets: Poses
    change: AtTargets
    kept: AtTargets
    renewed: float
    rest: float
    tolerance: float | None
    outside: float | None = None

    @property
    def told(self) -> Told:
        """How far a single cause is known: none where nothing changed, unclear where none explains."""
        if not self.difference.changed:
            return "none"
        first = next(iter(self.explanations), None)
        if first is None or not first.explains:
            return "unclear"
        return "named" if first.probability >= _NAMED else "ambiguous"

    @property
    def cause(self) -> Explanation | None:
        """The likeliest cause that explains the whole difference; None where none does."""
        return self.explanations[0] if self.told in ("named", "ambiguous") else None

    @cached_property
    def same_as(self) -> tuple[ChangeCause, ...]:
        """What looks like the likeliest cause at any measurement of these points."""
        if self.cause is None:
            return ()
        every = (explanation.cause for explanation in self.explanations)
        return same_as(self.difference, self.cause.cause, every)

    @property
    def expected(self) -> tuple[Interval, Interval]:
        """Errors at the targets if the earlier values are kept, RMS and worst, with all the rest."""
        return self.kept.rms.combined(self.rest), self.kept.worst.combined(self.rest)

    @property
    def verdict(self) -> Verdict | None:
        """Whether the worst target stays within the tolerance; None without one."""
        return None if self.tolerance is None else verdict(self.expected[1], self.tolerance)


def changes(
    cell: Cell,
    before: DayEstimate,
    after: DayEstimate,
    estimate: Estimate,
    tolerance: float | None = None,
) -> Changes:
    """Compare two results of one robot.

    cell : of the later result; estimate : Estimate, the later result itself
        without its poses, causes that follow load or approach are not asked; without those of both,
        what the model lacks may pass for a change
    tolerance : float, m, of the worst target

    Raises CalibError where one did not converge or nothing can be compared, InputError as
    :func:`calib.cell.targets.targets_of`.
    """
    if not estimate.converged:
        raise CalibError("the later result did not converge; mend the identification first")
    model, values, poses = estimate.model, estimate.values, after.poses
    found = difference(before, after)
    if before.poses is not None and after.poses is not None:
        days, excess = (before.poses, after.poses), max(before.excess, after.excess)
        follows = shown_otherwise(model, values, days, context_of(cell, after.poses), excess)
        own = follows[[model.keys.index(key) for key in found.keys]]
        found = replace(found, covariance=found.covariance + own @ own.T, lacking=own @ own.T)
    keys = {p.key: p for p in model.parameters}
    at = poses_at(generic_configurations(cell.robot, _GENERIC)) if poses is None else poses
    causes = candidates(found, model, values, at, context_of(cell, at))
    targets, weights = targets_of(cell)
    targets = replace(targets, start=estimate.start)
    rows = rows_at(model, values, targets, found, weights)
    change, kept = (
        at_targets(rows, *of, weights) for of in (found.best, (found.change, found.doubt))
    )
    scatter = scatter_at(model, values, targets, estimate.variances).mean(axis=1)
    share = weights / weights.sum()
    by_later = np.einsum("mrp,pq,mrq->m", rows, found.later, rows, optimize=True)
    return Changes(
        found,
        tuple(keys[key] for key in found.keys),
        explanations(found, causes),
        targets,
        change,
        kept,
        float(np.sqrt(max(float(share @ by_later), 0.0))),
        float(np.sqrt(share @ scatter + estimate.unexplained.rms**2)),
        tolerance,
        outside(before, after),
    )


def outside(before: DayEstimate, after: DayEstimate) -> float | None:
    """Upper limit of what came up that no parameter of the model can express, RMS at other poses, 3-D
    per point, m; None where a day tells no poses.

    All that is known of it is by how much more the later fit leaves than the earlier one, which is
    ``left^2 n / f`` a degree of freedom, n poses and f of them not spent on parameters. What is outside
    the model errs with the pose, so poses are counted and not points.
    """
    if before.poses is None or after.poses is None:
        return None
    (then, few), (now, others) = _square(before), _square(after)
    doubt = np.sqrt(2.0 * then**2 / few + 2.0 * now**2 / others)
    return float(np.sqrt(max(now - then, 0.0) + _LIMIT * doubt))


def _square(known: DayEstimate) -> tuple[float, float]:
    """Mean square of what a fit leaves, m^2, and its degrees of freedom."""
    poses = 0 if known.poses is None else len(known.poses)
    free = freedom(np.inf, poses, len(known.values), as_a_whole=True)
    return known.left**2 * poses / free, free


Verdict = Literal["holds", "does_not", "cannot_be_said"]


@dataclass(frozen=True, eq=False)
class AtTargets:
    """Errors over the m targets.

    rms, worst : Interval; worst_at : int, position of the target that errs most
    errors : ndarray, shape (m, 3), m, of each: value, low, high
    """

    rms: Interval
    worst: Interval
    worst_at: int
    errors: Array


def rows_at(
    model: Model, values: Array, targets: Poses, found: Difference, weights: Array
) -> Array:
    """How the error at each target follows the difference, shape (m, 3 M, k), RMS over M points.

    Bases and markers that are not compared are placed anew, so as to fit the targets best.
    """
    model = working_points(model)
    _, J = model.jacobian(values, targets)
    J = J.reshape(len(targets), -1, J.shape[-1]) / np.sqrt(len(model.markers))
    keys = model.keys
    own = J[..., [keys.index(key) for key in found.keys]]
    free = [i for i, key in enumerate(keys) if key[0] in ("base", "tool") and key not in found.keys]
    placed = J[..., free]
    placed = placed[..., np.abs(placed).max(axis=(0, 1)) > 0.0] if len(free) else placed
    if not placed.shape[-1]:
        return np.asarray(own)
    root = np.sqrt(weights)[:, None, None]
    flat = (root * placed).reshape(-1, placed.shape[-1])
    fit = np.linalg.lstsq(flat, (root * own).reshape(-1, own.shape[-1]), rcond=1e-9)[0]
    return np.asarray(own - placed @ fit)


def at_targets(rows: Array, change: Array, cov: Array, weights: Array) -> AtTargets:
    """Errors of a difference (k,) with its covariance (k, k).

    rows : ndarray, shape (m, R, k), of :func:`rows_at`; weights : ndarray, shape (m,)
    The worst target is that of the largest estimate; above it stands the largest upper limit of any.
    """
    roots, axes = np.linalg.eigh((cov + cov.T) / 2.0)
    half = axes * np.sqrt(np.maximum(roots, 0.0))
    moved, spread = rows @ change, rows @ half
    share = np.sqrt(weights / weights.sum())
    all_moved, all_spread = share[:, None] * moved, share[:, None, None] * spread
    whole = lengths(all_moved.reshape(1, -1), all_spread.reshape(1, -1, len(half)))[0]
    errors = lengths(moved, spread)
    counted = np.flatnonzero(weights > 0.0)
    at = int(counted[np.argmax(errors[counted, 0])])
    worst = Interval(float(errors[at, 0]), *errors[counted, 1:].max(axis=0).tolist())
    return AtTargets(Interval(*whole.tolist()), worst, at, errors)


def verdict(error: Interval, tolerance: float) -> Verdict:
    """Whether an error is within a tolerance, by its whole interval (decision rule of ISO 14253-1)."""
    if error.high <= tolerance:
        return "holds"
    return "does_not" if error.low > tolerance else "cannot_be_said"
