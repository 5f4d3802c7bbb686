"""What is asked of a plan: the arguments of :func:`doe.design`, held against those of the cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.cell import Cell
from calib.errors import CalibError, InputError
from calib.files.tables import holds_points, load_measurements, load_plan
from calib.poses import Measurements, Poses
from doe.criteria import UNASKED, catalogue
from doe.levels import AngleLevels

CANDIDATES = 20_000
"""Candidates that are drawn unless the user says otherwise."""
_MOST_POSES = 10_000


class CannotIdentify(CalibError):
    """No plan of this cell determines every parameter."""

    def __init__(self, names: tuple[str, ...], text: str) -> None:
        self.names = names
        super().__init__(text)


@dataclass(frozen=True, eq=False)
class Request:
    """What a user asks of a plan.

    criterion : str, a key of ``doe.criteria.catalogue()``
    of : effects or parameters that matter; rivals : two effects to tell apart, or None
    fixed : Poses measured in any case, or None
    candidates : how many are drawn, their angles moved a little after the choice, or those of a table
    at_markers : whether errors at the targets count at the markers, else at the tip's origin; None:
        where the markers are unknowns of the model
    """

    poses: int
    criterion: str
    levels: AngleLevels | None = None
    of: tuple[str, ...] = ()
    rivals: tuple[str, str] | None = None
    fixed: Poses | None = None
    candidates: int | Poses = CANDIDATES
    at_markers: bool | None = None
    seed: int = 0

    @property
    def extends(self) -> int:
        """Number of poses that are measured in any case."""
        return 0 if self.fixed is None else len(self.fixed)


def asked_count(cell: Cell, poses: int | None, levels: AngleLevels | None) -> int:
    """Number of poses to choose: as asked for, else by the levels, else by the cell."""
    by_levels, by_cell = None if levels is None else levels.poses, cell.design.poses
    count = poses or by_levels or by_cell
    if not count:
        raise CalibError("how many poses? ask for a number, or give poses in the cell's [design]")
    if poses is None and by_levels and by_cell and by_cell != by_levels:
        raise CalibError(
            f"the levels make {by_levels} poses and [design] poses is {by_cell}; change one of them"
        )
    if count > _MOST_POSES:
        raise CalibError(f"{count} poses are too many to choose; ask for at most {_MOST_POSES}")
    return int(count)


def asked_criterion(name: str, discriminate: tuple[str, str] | None, of: tuple[str, ...]) -> str:
    """Key of the criterion in the catalogue."""
    if of and (discriminate is not None or name not in ("Ds", "A", "E", "c")):
        said = "two rivals" if discriminate is not None else f"criterion {name}"
        raise CalibError(f"parameters of interest say nothing to {said}, but to Ds, A, E and c")
    if discriminate is not None:
        return UNASKED
    known = [one for one in catalogue() if one != UNASKED]
    if name not in known:
        raise InputError("criterion", "", f"{name!r} is unknown", f"known are {', '.join(known)}")
    return name


def measured(cell: Cell, given: str | Path | Poses | Measurements) -> Poses:
    """What is measured in any case, as poses of a plan: each is read free and, with a load, loaded."""
    if isinstance(given, str | Path):
        given = (load_measurements if holds_points(given) else load_plan)(cell, given)
    if isinstance(given, Poses):
        return given
    poses = given.poses
    loaded = poses.wrench.any(axis=1) | (poses.load_mass != 0.0)
    return poses.take(loaded) if cell.load is not None and loaded.any() else poses


def refuse_unplaced(cell: Cell) -> None:
    """Raise CalibError where an instrument reads nothing that can be foreseen."""
    for one in cell.instruments:
        if one.unforeseen:
            raise CalibError(
                f"what {one.kind} {one.name!r} would read cannot be foreseen: {one.unforeseen}"
            )


def refuse_touching(cell: Cell) -> None:
    """Raise CalibError where an instrument is touched: no candidate is brought to it."""
    for one in cell.instruments:
        if one.touches:
            raise CalibError(
                f"poses that touch {one.kind} {one.name!r} are not planned for; choose them by hand, "
                "and judge them with posecal compare"
            )
