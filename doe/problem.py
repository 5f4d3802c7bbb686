"""The design problem of a cell: model, candidates, rules and criterion, ready to be solved."""

from __future__ import annotations

from dataclasses import dataclass
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
from doe.candidates import (
    MOST_PROBED,
    PROBE,
    Pool,
    chunked,
    drawn,
    pool_of,
    probe_of,
    rounded,
)
from doe.constraints import Constraint, constraints_of, scene_of, visible
from doe.criteria import Criterion, Question, catalogue
from doe.information import Regressor, TargetErrors, nominal
from doe.levels import at_level
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.selection import Selection
from doe.parameters import (
    check_count,
    check_identifiable,
    interest_of,
    rival_rows,
    with_rivals,
    without_idle,
    without_unplanned,
)
from doe.request import CannotIdentify, Request, refuse_touching, refuse_unplaced

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
        known, fixed = self.regressor.known, self.request.fixed
        M = RIDGE * np.eye(known.shape[1]) + known.T @ known
        return M if fixed is None else M + self.information(fixed.q).sum(axis=0)

    def information(self, q: Array) -> Array:
        """Information matrix of configurations (m, dof), hidden markers left out, (m, p, p)."""
        if not len(q):
            return np.zeros((0, len(self.regressor.T), len(self.regressor.T)))
        return self.regressor.information(q, visible(scene_of(self.cell, q)))

    def blocks(self, pool: Pool) -> Blocks:
        """Information of a pool beside what is fixed."""
        return Blocks(pool.packed, self.fixed, self.regressor.rank)

    def posed(self, pool: Pool) -> Selection:
        """The choice of a plan from a pool."""
        return Selection(self.criterion, self.blocks(pool), self.rules(pool.level))

    def rules(self, level: IntArray) -> Allowed:
        """Which sets of candidates make a plan, for candidates at these levels."""
        levels, repeats = self.request.levels, self.request.repeats
        if levels is None:
            return Allowed.any_of(len(level), self.request.poses, repeats)
        counts = np.full(len(levels.values), levels.per_level)
        return Allowed(level, levels.values, counts, levels.used, levels.separation, repeats)

    def candidates(self) -> Pool:
        """Candidates, enough of them at every level. Raises CalibError saying what removed them."""
        request, levels, source = self.request, self.request.levels, self.request.candidates
        if isinstance(source, Poses):
            _check_rows(self.cell, request, source)
            chunks, count = chunked(source.q), len(source)
        else:
            chunks, count = drawn(self.cell, source, levels, request.seed), source
        pool = pool_of(self.regressor, self.constraints, levels, chunks, count)
        if request.fixed is not None and not request.repeats:
            pool = pool.without(request.fixed.q)
        self._check_enough(pool)
        return pool

    def _check_enough(self, pool: Pool) -> None:
        if not len(pool):
            raise pool.too_few()
        rules = self.rules(pool.level)
        if rules.chooses_levels:
            if not np.isfinite(rules.best(np.zeros(len(pool)))[0]):
                raise pool.too_few(f" for each of {rules.used} levels far enough apart")
            return
        for level, (members, count) in enumerate(zip(rules.members, rules.counts, strict=True)):
            needed = 1 if rules.repeats else int(count)
            if len(members) < needed:
                where = at_level(self.cell, self.request.levels, level)
                raise pool.too_few(where, len(members), needed)


def _check_rows(cell: Cell, request: Request, table: Poses) -> None:
    """Refuse a table of candidates without a row at a level that is wanted."""
    levels = request.levels
    if levels is None or not levels.chosen:
        return
    for level in np.setdiff1d(np.arange(len(levels.values)), levels.of(table.q)):
        where = at_level(cell, levels, int(level))
        raise CalibError(f"the table of candidates has no row{where}; add some")


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
    probe = probe_of(cell, constraints, request.levels, chain([first], chunks))
    regressor, left_out = _regressor(cell, request, model, angles, probe)
    targets, at = _targets(regressor, request)
    question = Question(
        regressor.model,
        regressor.T,
        interest_of(regressor.model, request),
        at.rows,
        at.weights,
        regressor.information(probe.q[:_REGION], probe.seen[:_REGION]),
        rival_rows(regressor.model, request.rivals),
    )
    criterion = catalogue()[request.criterion].of(question)
    if criterion.whole:
        check_count(regressor, request, poses_at(probe.q))
    return Problem(
        cell, request, regressor, constraints, criterion, targets, at, left_out, unplanned
    )


def _regressor(
    cell: Cell, request: Request, model: Model, angles: Poses, probe: Pool
) -> tuple[Regressor, tuple[Unidentifiable, ...]]:
    """The model without what no plan could show, in the coordinates of the criteria, and that."""
    try:
        refuse_idle_effects(cell, model, readings(cell, poses_at(probe.q)))
    except CalibError as error:
        raise CannotIdentify((), str(error)) from None
    regressor = Regressor.nominal(cell, model, nominal(model, angles))
    rows = regressor.rows(probe.q, probe.seen)
    effects, left_out = without_idle(regressor, rows, request)
    if left_out:
        model = model.with_effects(effects)
        regressor = Regressor.nominal(cell, model, nominal(model, angles))
        rows = regressor.rows(probe.q, probe.seen)
    check_identifiable(regressor, rows, request)
    known = regressor.known.T @ regressor.known / request.poses
    return regressor.whitened((np.swapaxes(rows, -1, -2) @ rows).mean(axis=0) + known), left_out


def _targets(regressor: Regressor, request: Request) -> tuple[Poses, TargetErrors]:
    """Where accuracy is wanted, and the errors there."""
    cell = regressor.cell
    targets, weights = targets_of(cell)
    try:
        check_targets(cell, targets)
    except CalibError as error:
        raise InputError(cell.targets_source or cell.path, "", str(error)) from None
    model, values = regressor.model, regressor.values
    at = TargetErrors.of(model, values, targets, weights, request.at_markers)
    return targets, at.per(regressor.T)


def _angles(cell: Cell, request: Request, probe: Array) -> Poses:
    """Poses from which angle-dependent effects take their knots: the levels, else the whole range.

    probe : ndarray, shape (m, dof), some of the candidates
    """
    ends = rounded(cell, cell.robot.sample_limits().T)
    if request.levels is not None:
        ends[:, request.levels.joint] = request.levels.values[[0, -1]]
    return poses_at(np.concatenate([probe, cell.robot.tied(ends)]))
