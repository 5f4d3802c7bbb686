"""A first look at a cell: feasible configurations, and what no plan of it could determine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.arm.statics import loads_of
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.errors import CalibError
from calib.model import Model
from calib.model.covariance import identifiable
from calib.poses import poses_at
from doe.constraints import Constraint
from doe.problem.information import Regressor
from doe.problem.pool import Chunk, drawn, fallen_of, judge
from doe.problem.refusals import CannotIdentify, at_level, no_candidate
from doe.problem.request import Request

PROBE = 2000
"""Feasible configurations that are enough to know a cell by."""
_PER_LEVEL, _LONGEST = 20, 65_536


def probe_of(
    regressor: Regressor, constraints: tuple[Constraint, ...], request: Request, seed: int
) -> tuple[Array, Mask]:
    """Feasible configurations of every level, shape (m, dof), and their visible markers, shape (m, M).

    What the cell is like. Raises CalibError where a level has none.
    """
    levels = request.levels
    count = 1 if levels is None else len(levels.values)
    found: list[Chunk] = []
    per_level, tried = np.zeros(count, dtype=int), 0
    for q in drawn(regressor.cell, _LONGEST, levels, seed + 1):
        found.append(judge(regressor, constraints, levels, q))
        tried += len(q)
        per_level += np.bincount(found[-1].level, minlength=count)
        every = levels is None or not levels.chosen or per_level.min() >= _PER_LEVEL
        if per_level.sum() >= PROBE and every:
            break
    needed = per_level if levels is not None and levels.chosen else per_level.sum(keepdims=True)
    for level in np.flatnonzero(needed == 0)[:1]:
        fallen = fallen_of(found)
        if len(needed) == 1:
            raise CalibError(no_candidate(tried, {n: int(f.sum()) for n, f in fallen.items()}))
        removed = {name: int(counts[level]) for name, counts in fallen.items()}
        where = at_level(regressor.cell, levels, int(level))
        raise CalibError(no_candidate(tried // count, removed, where))
    return (
        np.concatenate([part.q for part in found]),
        np.concatenate([part.visible for part in found]),
    )


def is_silent(cell: Cell, rows: Array) -> bool:
    """Whether the free readings carry nothing; they are the first half of the rows."""
    return cell.load is not None and not rows[:, : rows.shape[1] // 2].any()


def check_identifiable(regressor: Regressor, rows: Array, request: Request) -> None:
    """Refuse a model that no plan of the size determines. Raises CannotIdentify.

    rows : ndarray, shape (m, rows, p), of feasible configurations, columns in plausible sizes
    """
    cell, model = regressor.cell, regressor.model
    m, count, p = rows.shape
    extra = 0 if request.fixed is None else len(request.fixed)
    silent = is_silent(cell, rows)
    each, held = count // 2 if silent else count, regressor.known
    equations = (request.poses + extra) * each + len(held)
    if equations < p:
        least = -(-(p - len(held)) // each) - extra
        raise CannotIdentify(
            (),
            f"{request.poses} poses give {equations} equations for {p} parameters; "
            f"ask for at least {least} poses, or take effects out of [model] effects",
        )
    scaled = np.concatenate([rows.reshape(-1, p) * np.sqrt((request.poses + extra) / m), held])
    ids = tuple(parameter.id for parameter in model.parameters)
    found = identifiable(scaled, np.ones(p), ids)
    if found.unidentifiable:
        lost = [name for entry in found.unidentifiable for name in entry.names]
        reason = found.unidentifiable[0].reason
        rivals = request.rivals or ()
        if lost and all(name.startswith(tuple(f"{r}." for r in rivals)) for name in lost):
            raise CannotIdentify(
                tuple(lost),
                f"no plan tells {' from '.join(rivals)}: {reason} ({', '.join(lost)}); name others",
            )
        raise CannotIdentify(
            tuple(lost),
            f"no plan determines {', '.join(lost)}: {reason}; {_help(cell, model, lost)}",
        )


def _help(cell: Cell, model: Model, lost: Sequence[str]) -> str:
    elastic = any("compliance" in name or "stiffness" in name for name in lost)
    out = "take it out of [model] effects"
    if not elastic:
        return f"{out}, free more joints, or add markers"
    loads = loads_of(
        model.robot, poses_at(np.zeros((1, cell.robot.dof))), cell.payload, cell.gravity
    )
    if cell.load is None and loads.absent:
        return f"{out}, or give a [load]"
    return f"{out}, or move the load off the joint's axis: [load] com_mm, a force across gravity"
