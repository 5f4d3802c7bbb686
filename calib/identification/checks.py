"""What is refused before anything is fitted: options, too few readings, points out of all reach."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.effects.tool_base import Base, Body, Tool
from calib.errors import CalibError, TooFewPoses
from calib.instruments import Tracker
from calib.model import Model
from calib.observations import orientable
from calib.poses import Measurements

_NO_UNIT = 1e5  # arm lengths between points, beyond which no wrong unit explains them
_CHOICES = {
    "approach": ("points", "pose"),
    "method": ("joint", "two-step"),
    "weighting": ("full", "normalised", "plain"),
}


def check_options(length: float, **chosen: str) -> None:
    """Refuse options that are unknown; ``length``, m, of approach pose."""
    for name, known in _CHOICES.items():
        if chosen[name] not in known:
            raise CalibError(f"{chosen[name]!r} is unknown; choose {' or '.join(known)}")
    if not 0.0 < length < np.inf:
        raise CalibError(f"the characteristic length {length} must be a length above zero")


def check_counts(model: Model, data: Measurements, share: float = 1.0) -> None:
    """Refuse what no choice of so few poses could determine.

    share : of the errors that the readings must determine, beside all places; their sizes hold the rest

    Raises TooFewPoses with the number that is needed, CalibError for points that no arm of this size
    could have reached.
    """
    if (tracked := model.tracked(data)) is not None:
        refuse_unreachable(*tracked, _NO_UNIT)
    p, places = len(model.parameters), len(model.where(Base, Tool))
    needed, (count, each, beside) = places + share * (p - places), _equations(model, data)
    if count < needed:
        measured = int(data.seen.any(axis=1).sum())
        raise TooFewPoses(measured, int(np.ceil((needed - beside) / each)), p, count)


def outnumbered(model: Model, data: Measurements) -> bool:
    """Whether there are more parameters than any choice of so few poses could determine."""
    return _equations(model, data)[0] < len(model.parameters)


def _equations(model: Model, data: Measurements) -> tuple[int, int, int]:
    """How many equations there are, at most how many of a pose, and how many beside the poses.

    A reading of M markers on a tip fixes at most 3, 5 or 6 rigid coordinates (M = 1, 2, more), that of
    a body 6; the shape of the set of markers and bodies is common to all readings.
    """
    bodies = [e.marker for e in model.effects if isinstance(e, Body)]
    channels, rigid, coordinates = model.readout.channels, 0, 0
    read = np.concatenate([i.read_of(len(model.markers)) for i in channels.instruments])
    for _, riding in model.by_tip:
        markers = np.intersect1d(riding, read)
        turned = sum(body in markers for body in bodies)
        numbers = 3 * (len(markers) - 3 * turned) + 6 * turned
        rigid += {3: 3, 6: 5}.get(numbers, 6) if len(markers) < 3 else 6
        coordinates += numbers
    shape = coordinates - rigid if len(model.where(Tool)) else 0
    measured, numbers = int(data.seen.any(axis=1).sum()), int((data.seen * channels.rows).sum())
    placed = sum(
        len(e.parameters) for e in model.effects if isinstance(e, Base) and not e.of.has_stations
    )
    known = model.prior_rows
    count = min(numbers, rigid * measured + shape + placed) + known
    return count, rigid, shape + known


def refuse_unreachable(model: Model, data: Measurements, lengths: float) -> None:
    """Refuse points that lie more than so many arm lengths apart. Raises CalibError."""
    points = data.points[data.seen]
    if not len(points):  # the counts say what is missing
        return
    spread = float(np.ptp(points, axis=0).max())
    if spread > lengths * model.robot.reach:
        raise CalibError(
            f"the points lie {spread:.0f} m apart and the arm is {model.robot.reach:.1f} m long; check "
            "the units of the points' columns and of the robot's file"
        )


def check_orientable(model: Model, data: Measurements, start: Array) -> None:
    """Refuse approach pose where no orientation can be had."""
    if not all(type(i) is Tracker for i in model.instruments):
        raise CalibError(
            "approach pose makes poses of the points that a tracker reads of several markers; here "
            "readings are of other kinds, so use approach points"
        )
    if model.scattered:
        raise CalibError(
            "approach pose makes the tip's pose of markers on one link; here they ride on several, so "
            "use approach points"
        )
    if not orientable(model.marker_positions(start), data.seen).any():
        raise CalibError(
            "approach pose needs three visible markers that are not in line; "
            "measure more markers, or use approach points"
        )
