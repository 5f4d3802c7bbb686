"""Which effects of a cell a plan is for, and which of their parameters matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects import catalogue
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import parse_effect
from doe.problem.request import CannotIdentify, Request

_LARGEST_FACTOR = 1e9  # of one parameter in a combination, for values in their units


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
    CalibError where a name is unknown, or a factor cannot be read or is zero.
    """
    if not request.of:
        return None
    one = np.eye(len(model.parameters))
    if request.criterion != "c":
        rows = sorted({row for text in request.of for row in _known(model, text)})
        return np.asarray(one[rows])
    direction = np.zeros((1, len(one)))
    for text in request.of:
        name, _, factor = text.partition("=")
        rows = _known(model, name)
        if len(rows) != 1:
            raise CalibError(
                f"of {name!r} names {len(rows)} parameters; a combination takes single ones"
            )
        direction[0, rows] = _factor(text, factor or "1")
    return direction


def _factor(text: str, factor: str) -> float:
    try:
        number = float(factor)
    except ValueError:
        number = 0.0
    if not 1.0 / _LARGEST_FACTOR <= abs(number) <= _LARGEST_FACTOR:
        raise CalibError(
            f"of {text!r}: {factor!r} is no factor of plausible size; write NAME=FACTOR"
        )
    return number


def _matches(model: Model, text: str) -> list[int]:
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
