"""What changed on a robot between two results, what that does, why, and whether it still holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.change.at_targets import AtTargets, Length, Verdict, at_targets, rows_at, verdict
from calib.change.causes import (
    Cause,
    Explanation,
    candidates,
    explanations,
    same_as,
    shown_otherwise,
)
from calib.change.difference import Difference, difference
from calib.change.known import Known
from calib.compensation.estimate import Estimate
from calib.compensation.unexplained import scatter_at
from calib.effects.protocol import Parameter
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import context_of
from calib.model.reduction import generic_configurations
from calib.poses import Poses, poses_at
from calib.uncertainty.expanded import freedom

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
        """The likeliest cause that explains all."""
        return self.explanations[0] if self.told in ("named", "ambiguous") else None

    @cached_property
    def same_as(self) -> tuple[Cause, ...]:
        """What looks like the likeliest cause at any measurement of these points."""
        if self.cause is None:
            return ()
        every = (explanation.cause for explanation in self.explanations)
        return same_as(self.difference, self.cause.cause, every)

    @property
    def expected(self) -> tuple[Length, Length]:
        """Errors at the targets if the earlier values are kept, RMS and worst, with all the rest."""
        return self.kept.rms.beside(self.rest), self.kept.worst.beside(self.rest)

    @property
    def verdict(self) -> Verdict | None:
        """Whether the worst target stays within the tolerance; None without one."""
        return None if self.tolerance is None else verdict(self.expected[1], self.tolerance)


def changes(
    cell: Cell,
    before: Known,
    after: Known,
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
    found = _with_lacking(cell, model, values, difference(before, after), before, after)
    keys = {(p.effect, p.where, p.name): p for p in model.parameters}
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
    return Changes(
        found,
        tuple(keys[key] for key in found.keys),
        explanations(found, causes),
        targets,
        change,
        kept,
        _spread(rows, found.later, share),
        float(np.sqrt(share @ scatter + estimate.unexplained.rms**2)),
        tolerance,
        outside(before, after),
    )


def _with_lacking(
    cell: Cell, model: Model, values: Array, found: Difference, before: Known, after: Known
) -> Difference:
    """The difference with what the model lacks in its covariance."""
    if before.poses is None or after.poses is None:
        return found
    days, excess = (before.poses, after.poses), max(before.excess, after.excess)
    keys = [(p.effect, p.where, p.name) for p in model.parameters]
    rows = [keys.index(key) for key in found.keys]
    context = context_of(cell, after.poses)
    own = shown_otherwise(model, values, days, context, excess)[rows]
    return replace(found, covariance=found.covariance + own @ own.T, lacking=own @ own.T)


def _spread(rows: Array, cov: Array, share: Array) -> float:
    """RMS error that a covariance (k, k) leaves at the targets, m."""
    squared = np.einsum("mrp,pq,mrq->m", rows, cov, rows, optimize=True)
    return float(np.sqrt(max(float(share @ squared), 0.0)))


def outside(before: Known, after: Known) -> float | None:
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


def _square(known: Known) -> tuple[float, float]:
    """Mean square of what a fit leaves, m^2, and its degrees of freedom."""
    poses = 0 if known.poses is None else len(known.poses)
    free = freedom(np.inf, poses, len(known.values), as_a_whole=True)
    return known.left**2 * poses / free, free
