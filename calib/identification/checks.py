"""What an estimate cannot be made of, said before it is tried."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.effects.base import Base
from calib.effects.tool import Body, Tool
from calib.errors import CalibError, TooFewPoses
from calib.identification.mistakes import refuse_unreachable
from calib.instruments import Tracker
from calib.model import Model
from calib.observations import orientable
from calib.poses import Measurements

_NO_UNIT = 1e5  # arm lengths between points, beyond which no wrong unit explains them


def check_options(
    approach: str, method: str, weighting: str, length: float, differences: bool
) -> None:
    """Refuse options that are unknown or do not go together."""
    for value, known in (
        (approach, ("points", "pose")),
        (method, ("joint", "two-step")),
        (weighting, ("full", "normalised", "plain")),
    ):
        if value not in known:
            raise CalibError(f"{value!r} is unknown; choose {' or '.join(known)}")
    if not 0.0 < length < np.inf:
        raise CalibError(f"the characteristic length {length} must be a length above zero")
    if differences and (approach != "points" or method != "joint"):
        raise CalibError("differences go with approach points and method joint; drop one of them")


def check_counts(model: Model, data: Measurements, share: float = 1.0) -> None:
    """Refuse what no choice of so few poses could determine.

    A reading of M markers fixes at most 3, 5 or 6 rigid coordinates (M = 1, 2, more), that of a body 6;
    the shape of the set of markers and bodies is common to all readings.
    share : of the errors that the readings must determine, beside all places; their sizes hold the rest

    Raises TooFewPoses with the number that is needed, CalibError for points that no arm of this size
    could have reached.
    """
    if (tracked := model.tracked(data)) is not None:
        refuse_unreachable(*tracked, _NO_UNIT)
    p, places = len(model.parameters), len(model.where(Base, Tool))
    needed = places + share * (p - places)
    equations, each, beside = _equations(model, data)
    if equations < needed:
        measured = int(data.seen.any(axis=1).sum())
        raise TooFewPoses(measured, int(np.ceil((needed - beside) / each)), p, equations)


def outnumbered(model: Model, data: Measurements) -> bool:
    """Whether there are more parameters than any choice of so few poses could determine."""
    return _equations(model, data)[0] < len(model.parameters)


def _equations(model: Model, data: Measurements) -> tuple[int, int, int]:
    """How many there are, at most how many of a pose, and how many beside the poses."""
    coordinates = _coordinates(model)
    rigid = {3: 3, 6: 5}.get(coordinates, 6) if len(model.markers) < 3 else 6
    shape = coordinates - rigid if len(model.where(Tool)) else 0
    measured = int(data.seen.any(axis=1).sum())
    placed = sum(
        len(e.parameters) for e in model.effects if isinstance(e, Base) and not e.of.stationed
    )
    numbers = int((data.seen * model.readout.channels.rows).sum())
    known = model.prior_rows
    equations = min(numbers, rigid * measured + shape + placed) + known
    return equations, rigid, shape + known


def _coordinates(model: Model) -> int:
    """How many numbers say where the markers and bodies are on the tip."""
    bodies = sum(isinstance(e, Body) for e in model.effects)
    return 3 * (len(model.markers) - 3 * bodies) + 6 * bodies


def check_orientable(model: Model, data: Measurements, start: Array) -> None:
    """Refuse approach pose where no orientation can be had."""
    if not all(type(i) is Tracker for i in model.instruments):
        raise CalibError(
            "approach pose makes poses of the points that a tracker reads of several markers; here "
            "readings are of other kinds, so use approach points"
        )
    if not orientable(model.marker_positions(start), data.seen).any():
        raise CalibError(
            "approach pose needs three visible markers that are not in line; "
            "measure more markers, or use approach points"
        )
