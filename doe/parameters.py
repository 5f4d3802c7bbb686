"""Which effects of a cell a plan is for, which of their parameters matter, and what no plan determines.

That is left out where nothing can be done about it, else refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects import Effect, catalogue
from calib.effects.protocol import ElasticEffect
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import parse_effect
from calib.model.covariance import Unidentifiable, identifiable
from doe.information import Regressor
from doe.request import CannotIdentify, Request

_LARGEST_FACTOR = 1e9  # of one parameter in a combination, for values in their units
_NAMED = 8  # parameters of one reason that a refusal names


def without_unplanned(cell: Cell) -> tuple[Cell, tuple[str, ...]]:
    """The cell without those effects of its model that depend on more than joints and load, and these.

    No choice of poses settles the order, the sides and the times of the readings. Raises CannotIdentify
    where nothing else is left.
    """
    kinds, names = catalogue(), {text: parse_effect(text)[0] for text in cell.effects}
    left = tuple(text for text, name in names.items() if name in kinds and kinds[name].uses)
    if left and len(left) == len(cell.effects):
        uses = " and ".join(sorted(kinds[names[left[0]]].uses))
        raise CannotIdentify(
            (),
            f"{left[0]} depends on {uses}, which no choice of poses settles; add effects that depend "
            "on joints to [model] effects",
        )
    return replace(cell, effects=tuple(e for e in cell.effects if e not in left)), left


def with_rivals(cell: Cell, rivals: tuple[str, str]) -> Cell:
    """The cell with both rivals in its model. Raises CalibError, UnknownEffect."""
    modelled = [parse_effect(text) for text in cell.effects]
    everywhere = {name for name, places in modelled if places is None}
    present = {(name, where) for name, places in modelled for where in places or ()}
    added = []
    for text in rivals:
        name, places = parse_effect(text)
        if places is None or len(places) != 1:
            raise CalibError(f"rival {text!r} needs one place, as in joint_compliance:A2")
        if catalogue()[name].uses:
            known = " and ".join(sorted(catalogue()[name].uses))
            raise CalibError(
                f"rival {text!r} depends on {known}, which no choice of poses settles; "
                "judge a plan in its order, as posecal diagnose does of a plan"
            )
        for whole, kind in catalogue().items():
            if name in kind.parts and (whole in everywhere or (whole, places[0]) in present):
                raise CalibError(
                    f"rival {text!r} is a part of {whole}, which the model has already"
                )
        if name not in everywhere and (name, places[0]) not in present:
            added.append(text)
    return replace(cell, effects=(*cell.effects, *added))


def rival_rows(model: Model, rivals: tuple[str, str] | None) -> tuple[IntArray, IntArray] | None:
    """Positions of the parameters of either rival, None without rivals. Raises CannotIdentify."""
    if rivals is None:
        return None
    first, second = (_matches(model, text) for text in rivals)
    for text, rows in zip(rivals, (first, second), strict=True):
        if not rows:
            raise CannotIdentify(
                (text,),
                f"{text}: the rest of the model moves the markers alike; no pose tells it apart",
            )
    return np.array(first), np.array(second)


def interest_of(model: Model, request: Request) -> Array | None:
    """Combinations of the parameters, in their units, that matter, shape (s, p); None for all.

    The one of ``c`` is the sum of ``NAME=FACTOR``, else each parameter stands by itself. Raises
    CalibError where a name is unknown, or a factor cannot be read.
    """
    if not request.of:
        return None
    one = np.eye(len(model.parameters))
    if request.criterion != "c":
        return one[sorted({row for text in request.of for row in _known(model, text)})]
    direction = np.zeros((1, len(one)))
    for text in request.of:
        name, _, written = text.partition("=")
        factor = _number(written or "1")
        if not 1.0 / _LARGEST_FACTOR <= abs(factor) <= _LARGEST_FACTOR:
            raise CalibError(f"of {text!r}: {written!r} is no plausible factor; write NAME=FACTOR")
        direction[0, _known(model, name)] = factor
    return direction


def _number(text: str) -> float:
    """The number, NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _matches(model: Model, text: str) -> list[int]:
    """Positions of a parameter, or of the parameters of an effect, at one place or everywhere."""
    name, _, where = text.partition(":")
    return [
        i
        for i, p in enumerate(model.parameters)
        if text == p.id or (p.effect == name and (not where or p.where == where))
    ]


def _known(model: Model, text: str) -> list[int]:
    rows = _matches(model, text)
    if not rows:
        known = ", ".join(dict.fromkeys(p.effect for p in model.parameters))
        raise CalibError(
            f"of {text!r} is no parameter or effect of the model; there are {known}, each with its "
            f"places and parameters, as in {model.parameters[-1].id}"
        )
    return rows


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
    p = rows.shape[2]
    # Free of load a pose may tell nothing.
    each = int(rows.any(axis=(0, 2)).sum())
    least = -(-(p - len(regressor.known)) // each) - request.extends if each else 0
    if request.poses < least:
        raise CannotIdentify(
            (),
            f"{request.poses} poses give too few equations for {p} parameters; ask for at least "
            f"{least} poses, or take effects out of [model] effects",
        )
    lost = _undetermined(regressor, rows, request)
    if not lost:
        return
    names, rivals = tuple(name for entry in lost for name in entry.names), request.rivals or ()
    if all(name.startswith(tuple(f"{r}." for r in rivals)) for name in names):
        apart = f"no plan tells {' from '.join(rivals)}: {lost[0].reason} ({', '.join(names)})"
        raise CannotIdentify(names, f"{apart}; name others")
    remedy = _help(regressor, names)
    raise CannotIdentify(names, f"no plan determines {by_reason(lost)}; {remedy}")


def by_reason(lost: Sequence[Unidentifiable]) -> str:
    """Parameters by the reason why they are lost, each reason once."""
    names_of: dict[str, list[str]] = {}
    for entry in lost:
        names_of.setdefault(entry.reason, []).extend(entry.names)
    return "; ".join(
        f"{', '.join(names[:_NAMED])}{' ..' * (len(names) > _NAMED)}: {reason}"
        for reason, names in names_of.items()
    )


def _undetermined(
    regressor: Regressor, rows: Array, request: Request
) -> tuple[Unidentifiable, ...]:
    """Parameters of which a plan of the size tells less than twenty plausible sizes, one an entry."""
    m, _, p = rows.shape
    share = np.sqrt((request.poses + request.extends) / m)
    scaled = np.concatenate([rows.reshape(-1, p) * share, regressor.known])
    ids = tuple(parameter.id for parameter in regressor.model.parameters)
    return identifiable(scaled, np.ones(p), ids).unidentifiable


def _help(regressor: Regressor, lost: Sequence[str]) -> str:
    out = "take it out of [model] effects"
    if not any("compliance" in name or "stiffness" in name for name in lost):
        return f"{out}, free more joints, or add markers"
    if regressor.cell.load is None:
        return f"{out}, or give a [load]"
    return f"{out}, or move the load off the joint's axis: [load] com_mm, a force across gravity"
