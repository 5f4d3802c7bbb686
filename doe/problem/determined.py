"""What no plan of a cell determines: left out where nothing can be done about it, else refused."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.arm.statics import loads_of
from calib.arrays import Array
from calib.cell import Cell
from calib.effects import Effect
from calib.effects.protocol import ElasticEffect
from calib.model import Model
from calib.model.build import parse_effect
from calib.model.covariance import Unidentifiable, identifiable
from calib.poses import poses_at
from doe.problem.linearisation import Regressor
from doe.problem.request import CannotIdentify, Request

_NAMED = 8  # parameters of one reason that a refusal names


def without_idle(
    regressor: Regressor, rows: Array, request: Request
) -> tuple[tuple[Effect, ...], tuple[Unidentifiable, ...]]:
    """Effects of the model that a plan is for, and the elastic parameters that are left out of it.

    Under the arm's own weight an elastic effect that is named for every place may stand idle at some:
    no weight turns a vertical axis, or a wrist whose links balance. Identification keeps those at
    nominal. A ``[load]`` could be moved, and what is named with its place is wanted: neither is left
    out.

    rows : ndarray, shape (m, rows, p), of feasible configurations, columns in plausible sizes
    """
    cell, effects = regressor.cell, regressor.model.effects
    wanted = {(name, at) for name, places in map(parse_effect, cell.effects) for at in places or ()}
    spare = [e for e in effects if isinstance(e, ElasticEffect) and (e.kind, e.where) not in wanted]
    if cell.load is not None or not spare:
        return effects, ()
    lost = {entry.names[0]: entry for entry in _undetermined(regressor, rows, request)}
    idle = [e for e in spare if all(p.id in lost for p in e.parameters)]
    left = tuple(lost[p.id] for e in idle for p in e.parameters)
    return tuple(e for e in effects if e not in idle), left


def check_identifiable(regressor: Regressor, rows: Array, request: Request) -> None:
    """Refuse a model that no plan of the size determines. Raises CannotIdentify.

    rows : ndarray, shape (m, rows, p), of feasible configurations, columns in plausible sizes
    """
    cell, model, p = regressor.cell, regressor.model, rows.shape[2]
    extra = 0 if request.fixed is None else len(request.fixed)
    # Free of load a pose may tell nothing.
    each, held = int(rows.any(axis=(0, 2)).sum()), regressor.known
    equations = (request.poses + extra) * each + len(held)
    if equations < p:
        least = -(-(p - len(held)) // each) - extra
        raise CannotIdentify(
            (),
            f"{request.poses} poses give {equations} equations for {p} parameters; "
            f"ask for at least {least} poses, or take effects out of [model] effects",
        )
    found = _undetermined(regressor, rows, request)
    if not found:
        return
    lost = [name for entry in found for name in entry.names]
    rivals = request.rivals or ()
    if all(name.startswith(tuple(f"{r}." for r in rivals)) for name in lost):
        raise CannotIdentify(
            tuple(lost),
            f"no plan tells {' from '.join(rivals)}: {found[0].reason} ({', '.join(lost)}); "
            "name others",
        )
    raise CannotIdentify(
        tuple(lost), f"no plan determines {told(found)}; {_help(cell, model, lost)}"
    )


def told(lost: Sequence[Unidentifiable]) -> str:
    """Parameters by the reason why they are lost, each reason once."""
    by_reason: dict[str, list[str]] = {}
    for entry in lost:
        by_reason.setdefault(entry.reason, []).extend(entry.names)
    return "; ".join(
        f"{', '.join(names[:_NAMED])}{' ..' * (len(names) > _NAMED)}: {reason}"
        for reason, names in by_reason.items()
    )


def _undetermined(
    regressor: Regressor, rows: Array, request: Request
) -> tuple[Unidentifiable, ...]:
    """Parameters of which a plan of the size tells less than twenty plausible sizes, one an entry."""
    m, _, p = rows.shape
    poses = request.poses + (0 if request.fixed is None else len(request.fixed))
    scaled = np.concatenate([rows.reshape(-1, p) * np.sqrt(poses / m), regressor.known])
    ids = tuple(parameter.id for parameter in regressor.model.parameters)
    return identifiable(scaled, np.ones(p), ids).unidentifiable


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
