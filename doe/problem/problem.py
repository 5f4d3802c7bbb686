"""The design problem of a cell: model, candidates, rules and criterion, ready to be solved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from calib.api import readings
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.targets import check_targets, targets_of
from calib.errors import CalibError, InputError
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.model.covariance import Unidentifiable
from calib.poses import Poses, poses_at
from doe.constraints import Constraint, constraints_of, scene_of, visible
from doe.criteria import Criterion, Question, catalogue
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.selection import Selection
from doe.problem.determined import check_identifiable, is_silent, without_idle
from doe.problem.linearisation import Regressor, nominal
from doe.problem.pool import MOST_PROBED, PROBE, Pool, drawn, probe_of, rounded
from doe.problem.request import (
    CannotIdentify,
    Request,
    direction_of,
    refuse_touching,
    refuse_unplaced,
    rival_rows,
    subset_of,
    with_rivals,
    without_unplanned,
)
from doe.problem.target_errors import TargetErrors

RIDGE = 1e-10
"""Information that every plan has, in units of the pool's mean: singular plans get a tiny value."""
_REGION = 200


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything but the candidates.

    cell : Cell; with the rivals in its model where there are some
    request : Request
    regressor : Regressor, in coordinates in which the mean information of a probe is the identity
    constraints : tuple of Constraint
    criterion : Criterion
    targets : Poses; at_targets : TargetErrors, there, in the coordinates of the criteria
    left_out : tuple of Unidentifiable, elastic parameters that the arm's own weight does not show
    unplanned : tuple of str, effects of the user's model that depend on more than the joints
    """

    cell: Cell
    request: Request
    regressor: Regressor
    constraints: tuple[Constraint, ...]
    criterion: Criterion
    targets: Poses
    at_targets: TargetErrors
    left_out: tuple[Unidentifiable, ...] = ()
    unplanned: tuple[str, ...] = ()

    @property
    def model(self) -> Model:
        """The model that is to be identified."""
        return self.regressor.model

    @cached_property
    def fixed(self) -> Array:
        """Information of what is measured in any case, shape (p, p), made positive definite.

        What is known beside all readings is among it.
        """
        known = self.regressor.known
        M = RIDGE * np.eye(known.shape[1]) + known.T @ known
        fixed = self.request.fixed
        if fixed is not None:
            M = M + self.information(fixed.q).sum(axis=0)
        return M

    def information(self, q: Array) -> Array:
        """Information matrix of configurations (m, dof), hidden markers left out, (m, p, p)."""
        return self.regressor.information(q, visible(scene_of(self.cell, q)))

    def crossed(self, q: Array) -> Array:
        """By errors common to all readings, shape (m, p, b)."""
        return self.regressor.crossed(q, visible(scene_of(self.cell, q)))

    @cached_property
    def crossed_fixed(self) -> Array:
        """The same of what is measured in any case, shape (p, b)."""
        fixed = self.request.fixed
        if fixed is None:
            return np.zeros((len(self.regressor.T), self.at_targets.shifts.shape[-1]))
        return np.asarray(self.crossed(fixed.q).sum(axis=0))

    def blocks(self, pool: Pool) -> Blocks:
        """Information of a pool beside what is fixed."""
        return Blocks(pool.packed, self.fixed, self.regressor.rank)

    def posed(self, pool: Pool) -> Selection:
        """The choice of a plan from a pool."""
        return Selection(self.criterion, self.blocks(pool), self.rules(pool.level))

    def rules(self, level: IntArray) -> Allowed:
        """Which sets of candidates make a plan, for candidates at these levels."""
        levels = self.request.levels
        if levels is None:
            return Allowed.any_of(len(level), self.request.poses, self.request.repeats)
        counts = np.full(len(levels.values), levels.per_level)
        return Allowed(
            level, levels.values, counts, levels.used, levels.separation, self.request.repeats
        )


def problem_of(cell: Cell, request: Request) -> Problem:
    """Set up the model, its coordinates and the criterion.

    Raises CalibError: unknown effects, targets outside the limits, no feasible candidate, parameters
    that no plan determines (CannotIdentify), a criterion that lacks what it needs.
    """
    refuse_unplaced(cell)
    refuse_touching(cell)
    cell, unplanned = without_unplanned(cell)
    if request.rivals is not None:
        cell = with_rivals(cell, request.rivals)
    constraints = constraints_of(cell)
    chunks = drawn(cell, MOST_PROBED, request.levels, request.seed + 1)
    first = next(chunks)
    angles = readings(cell, _angles(cell, request, first[:PROBE]))
    model = build(cell, angles).model
    regressor = Regressor.nominal(cell, model, nominal(model, angles))
    probe, seen = probe_of(regressor, constraints, request, chain([first], chunks))
    try:
        refuse_idle_effects(cell, model, readings(cell, poses_at(probe)))
    except CalibError as error:
        raise CannotIdentify((), str(error)) from None
    rows = regressor.rows(probe, seen)
    effects, left_out = without_idle(regressor, rows, request)
    if left_out:
        model = model.with_effects(effects)
        regressor = Regressor.nominal(cell, model, nominal(model, angles))
        rows = regressor.rows(probe, seen)
    check_identifiable(regressor, rows, request)
    regressor = replace(regressor, loaded_only=is_silent(cell, rows))
    known = regressor.known.T @ regressor.known / request.poses
    regressor = regressor.whitened((np.swapaxes(rows, -1, -2) @ rows).mean(axis=0) + known)
    targets, weights = targets_of(cell)
    try:
        check_targets(cell, targets)
    except CalibError as error:
        where = cell.targets_source or cell.path
        raise InputError(where, "", str(error)) from None
    at = TargetErrors.of(model, regressor.values, targets, weights, request.at_markers)
    at = at.per(regressor.T)
    question = Question(
        model,
        regressor.T,
        subset_of(model, request),
        direction_of(model, request),
        lambda: at.rows,
        at.weights,
        regressor.information(probe[:_REGION], seen[:_REGION]),
        None if request.rivals is None else rival_rows(model, request.rivals),
    )
    criterion = catalogue()[request.criterion].of(question)
    return Problem(
        cell, request, regressor, constraints, criterion, targets, at, left_out, unplanned
    )


def _angles(cell: Cell, request: Request, probe: Array) -> Poses:
    """Poses from which angle-dependent effects take their knots: the levels, else the whole range.

    probe : ndarray, shape (m, dof), some of the candidates
    """
    ends = rounded(cell, cell.robot.sample_limits().T)
    if request.levels is not None:
        ends[:, request.levels.joint] = request.levels.values[[0, -1]]
    return poses_at(np.concatenate([probe, cell.robot.tied(ends)]))
