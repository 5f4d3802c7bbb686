"""What is asked of a plan, and what cannot be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects import catalogue
from calib.errors import CalibError
from calib.model import Model
from calib.model.build import parse_effect
from calib.poses import Poses
from doe.problem.levels import AngleLevels

CANDIDATES = 20_000
"""Candidates that are drawn unless the user says otherwise."""
_LARGEST_FACTOR = 1e9  # of one parameter in a combination, for values in their units


@dataclass(frozen=True, eq=False)
class Request:
    """What a user asks of a plan: the arguments of :func:`doe.design`, with those of the cell.

    criterion : str, a key of ``doe.criteria.catalogue()``
    fixed : Poses measured in any case, or None
    reapproaches : poses that are visited again, 0 for none; asked : whether they were asked for, else
        they are a default
    """

    poses: int
    criterion: str
    levels: AngleLevels | None = None
    of: tuple[str, ...] = ()
    rivals: tuple[str, str] | None = None
    fixed: Poses | None = None
    repeats: bool = False
    at_markers: bool | None = None
    candidates: int | Poses = CANDIDATES
    refine: bool = True
    curve: bool = False
    reapproaches: int = 0
    asked: bool = True
    seed: int = 0


def with_rivals(cell: Cell, rivals: tuple[str, str]) -> Cell:
    """The cell with both rivals in its model. Raises CalibError, UnknownEffect."""
    present = {
        (name, where) for name, places in map(parse_effect, cell.effects) for where in places or ()
    }
    everywhere = {name for name, places in map(parse_effect, cell.effects) if places is None}
    added = []
    for text in rivals:
        name, places = parse_effect(text)
        if places is None or len(places) != 1:
            raise CalibError(f"rival {text!r} needs one place, as in joint_compliance:A2")
        _check_rival(text, name, places[0], everywhere, present)
        if name not in everywhere and (name, places[0]) not in present:
            added.append(text)
    return replace(cell, effects=(*cell.effects, *added))


def _check_rival(
    text: str, name: str, place: str, everywhere: set[str], present: set[tuple[str, str]]
) -> None:
    """Refuse what no plan settles, and a part of what the model has."""
    if catalogue()[name].uses:
        known = " and ".join(sorted(catalogue()[name].uses))
        raise CalibError(
            f"rival {text!r} depends on {known}, which no choice of poses settles; "
            "judge a plan in its order, as posecal diagnose does of a plan"
        )
    for whole, kind in catalogue().items():
        if name in kind.parts and (whole in everywhere or (whole, place) in present):
            raise CalibError(f"rival {text!r} is a part of {whole}, which the model has already")


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


def rival_rows(model: Model, rivals: tuple[str, str]) -> tuple[IntArray, IntArray]:
    """Positions of the parameters of either rival. Raises CannotIdentify."""
    found = []
    for text in rivals:
        rows = _matches(model, text)
        if not rows:
            raise CannotIdentify(
                (text,),
                f"{text}: the rest of the model moves the markers alike; no pose tells it apart",
            )
        found.append(np.array(rows))
    return found[0], found[1]


def _matches(model: Model, text: str) -> list[int]:
    name, _, where = text.partition(":")
    return [
        i
        for i, p in enumerate(model.parameters)
        if text == p.id or (p.effect == name and (not where or p.where == where))
    ]


def subset_of(model: Model, request: Request) -> IntArray | None:
    """Positions of the parameters that matter, None for all. Raises CalibError."""
    if not request.of or request.criterion == "c":
        return None
    rows: list[int] = []
    for text in request.of:
        rows += _known(model, text)
    return np.unique(rows)


def direction_of(model: Model, request: Request) -> Array | None:
    """Factors of the combination, shape (p,), for parameters in their units; None but for ``c``.

    Raises CalibError where a factor cannot be read or is zero.
    """
    if not request.of or request.criterion != "c":
        return None
    direction = np.zeros(len(model.parameters))
    for text in request.of:
        name, _, factor = text.partition("=")
        try:
            number = float(factor or 1.0)
            if not 1.0 / _LARGEST_FACTOR <= abs(number) <= _LARGEST_FACTOR:
                raise ValueError
        except ValueError:
            raise CalibError(
                f"of {text!r}: {factor!r} is no factor of plausible size; write NAME=FACTOR"
            ) from None
        rows = _known(model, name)
        if len(rows) != 1:
            raise CalibError(
                f"of {name!r} names {len(rows)} parameters; a combination takes single ones"
            )
        direction[rows[0]] = number
    return direction


def _known(model: Model, text: str) -> list[int]:
    rows = _matches(model, text)
    if not rows:
        known = ", ".join(dict.fromkeys(p.effect for p in model.parameters))
        raise CalibError(
            f"of {text!r} is no parameter or effect of the model; there are {known}, each with its "
            f"places and parameters, as in {model.parameters[-1].id}"
        )
    return rows


class CannotIdentify(CalibError):
    """No plan of this cell determines every parameter."""

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self.names = names
        super().__init__(text)


def refuse_unplaced(cell: Cell) -> None:
    """Raise CalibError where an instrument reads nothing that can be foreseen."""
    for instrument in cell.instruments:
        if instrument.unforeseen:
            raise CalibError(
                f"what {instrument.kind} {instrument.name!r} would read cannot be foreseen: "
                f"{instrument.unforeseen}"
            )


def refuse_touching(cell: Cell) -> None:
    """Raise CalibError where an instrument is touched: no candidate is brought to it."""
    for instrument in cell.instruments:
        if instrument.touches:
            raise CalibError(
                f"poses that touch {instrument.kind} {instrument.name!r} are not planned for; choose "
                "them by hand, and judge them with posecal compare"
            )


def no_candidate(
    count: int, removed: dict[str, int], where: str = "", found: int = 0, needed: int = 1
) -> str:
    """Why nothing, or too little, is left to choose from."""
    what = f"no feasible candidate{where}"
    if found:
        only = f"only {found} feasible candidate{'s' if found > 1 else ''}"
        what = f"{only}{where}, and {needed} are needed"
    causes = sorted(((n, name) for name, n in removed.items() if n), reverse=True)
    if not causes:
        return f"{what}; draw more, or allow repeats"
    most, name = causes[0]
    if most >= count and name.startswith("obstacle"):
        return f"{what}: the arm meets {name} wherever it stands; move it, or make it smaller"
    said = ", ".join(f"{name} removed {n}" for n, name in causes)
    return f"{what}: of {count}, {said}; relax what removed most"
