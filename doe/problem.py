"""The design problem of a cell: model, candidates, rules and criterion, ready to be solved."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

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
from doe.candidates import CHUNK, WORKERS, Pool, candidates_of, rounded
from doe.constraints import Constraint, constraints_of, scene_of, visible
from doe.criteria import Criterion, Question, catalogue
from doe.information import Regressor, nominal, target_rows
from doe.levels import at_level
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack, packed_size
from doe.optimal.function import Selection
from doe.parameters import (
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
_LARGEST = 8e9  # bytes of information blocks
_PROBE = 2000  # candidates by which a cell is known
_REGION = 200


@dataclass(frozen=True, eq=False)
class Problem:
    """A choice of poses.

    cell : Cell; with the rivals in its model where there are some
    request : Request
    regressor : Regressor, in coordinates in which the mean information of candidates is the identity
    constraints : tuple of Constraint; pool : Pool, candidates that keep them and may be chosen
    criterion : Criterion
    targets : Poses; target_rows : ndarray, shape (K, r, p), of errors there, m, in the coordinates of
        the criteria; target_weights : ndarray, shape (K,), summing to one
    left_out : tuple of Unidentifiable, elastic parameters that the arm's own weight does not show
    unplanned : tuple of str, effects of the user's model that depend on more than the joints
    """

    cell: Cell
    request: Request
    regressor: Regressor
    constraints: tuple[Constraint, ...]
    pool: Pool
    criterion: Criterion
    targets: Poses
    target_rows: Array
    target_weights: Array
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

    def blocks(self, q: Array) -> Blocks:
        """Configurations (m, dof) by what they tell."""
        return Blocks(pack(self.information(q)), self.fixed, self.regressor.rank)

    def posed(self) -> Selection:
        """The choice of a plan from the pool. Raises CalibError where it would not fit into memory."""
        q, size = self.pool.q, packed_size(len(self.regressor.T))
        if 8.0 * len(q) * size > _LARGEST:
            raise CalibError(
                f"{len(q)} candidates for {len(self.regressor.T)} parameters need "
                f"{8e-9 * len(q) * size:.0f} GB; ask for at most {int(_LARGEST / 8.0 / size)}"
            )
        packed = np.empty((len(q), size))

        def fill(start: int) -> None:
            part = slice(start, start + CHUNK)
            seen = None if self.pool.seen[part].all() else self.pool.seen[part]
            packed[part] = pack(self.regressor.information(q[part], seen))

        with ThreadPoolExecutor(WORKERS) as executor:
            list(executor.map(fill, range(0, len(q), CHUNK)))
        blocks = Blocks(packed, self.fixed, self.regressor.rank)
        return Selection(self.criterion, blocks, self.rules(self.pool.level))

    def rules(self, level: IntArray) -> Allowed:
        """Which sets of candidates make a plan, for candidates at these levels."""
        return _rules(self.cell, self.request, level)


def problem_of(cell: Cell, request: Request) -> Problem:
    """Set up the model, the candidates, their coordinates and the criterion.

    Raises CalibError: unknown effects, targets outside the limits, no feasible candidate, parameters
    that no plan determines (CannotIdentify), a criterion that lacks what it needs.
    """
    refuse_unplaced(cell)
    refuse_touching(cell)
    cell, unplanned = without_unplanned(cell)
    if request.rivals is not None:
        cell = with_rivals(cell, request.rivals)
    constraints = constraints_of(cell)
    pool = candidates_of(cell, constraints, request.levels, request.candidates, request.seed)
    if request.fixed is not None and not cell.design.repeats:
        pool = pool.without(request.fixed.q)
    _check_count(cell, request, pool)
    probe = pool.take(np.random.default_rng(0).permutation(len(pool))[:_PROBE])
    regressor, left_out = _regressor(cell, request, probe)
    targets, rows, weights = _targets(regressor, request)
    question = Question(
        regressor.model,
        regressor.T,
        interest_of(regressor.model, request),
        rows,
        weights,
        regressor.information(probe.q[:_REGION], probe.seen[:_REGION]),
        rival_rows(regressor.model, request.rivals),
    )
    criterion = catalogue()[request.criterion].of(question)
    return Problem(
        cell, request, regressor, constraints, pool, criterion, targets, rows, weights, left_out,
        unplanned,
    )  # fmt: skip


def _rules(cell: Cell, request: Request, level: IntArray) -> Allowed:
    levels, repeats = request.levels, cell.design.repeats
    if levels is None:
        return Allowed.any_of(len(level), request.poses, repeats)
    counts = np.full(len(levels.values), levels.per_level)
    return Allowed(level, levels.values, counts, levels.used, levels.separation, repeats)


def _check_count(cell: Cell, request: Request, pool: Pool) -> None:
    """Refuse candidates that are too few for a plan."""
    rules = _rules(cell, request, pool.level)
    if rules.chooses_levels:
        if not np.isfinite(rules.best(np.zeros(len(pool)))[0]):
            raise pool.too_few(f" for each of {rules.used} levels far enough apart")
        return
    for level, (members, count) in enumerate(zip(rules.members, rules.counts, strict=True)):
        needed = 1 if rules.repeats else int(count)
        if len(members) < needed:
            raise pool.too_few(at_level(cell, request.levels, level), len(members), needed)


def _regressor(
    cell: Cell, request: Request, probe: Pool
) -> tuple[Regressor, tuple[Unidentifiable, ...]]:
    """The model without what no plan could show, in the coordinates of the criteria, and that."""
    # Angle-dependent effects take their knots from the levels, else from the whole range.
    ends = rounded(cell, cell.robot.sample_limits().T)
    if request.levels is not None:
        ends[:, request.levels.joint] = request.levels.values[[0, -1]]
    angles = readings(cell, poses_at(np.concatenate([probe.q, cell.robot.tied(ends)])))
    model = build(cell, angles).model
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


def _targets(regressor: Regressor, request: Request) -> tuple[Poses, Array, Array]:
    """Where accuracy is wanted, the rows of errors there, and the weights of them, summing to one."""
    cell = regressor.cell
    targets, weights = targets_of(cell)
    try:
        check_targets(cell, targets)
    except CalibError as error:
        own = cell.design.targets
        raise InputError(cell.path if own is None else own.path, "", str(error)) from None
    rows = target_rows(regressor.model, regressor.values, targets, request.at_markers)
    return targets, rows @ regressor.T, weights / weights.sum()
