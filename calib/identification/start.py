"""Where a search starts: instruments and markers placed from nothing but the readings, and weights.

What no choice of so few poses could determine is refused before it is tried.
"""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import Frames, forward
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.tool import Body, Tool
from calib.errors import CalibError, TooFewPoses
from calib.instruments import Instrument
from calib.instruments.protocol import Nominal
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

_ROOM = 10.0  # reaches of the arm
_ABSURD = 1e3  # plausible sizes
_NO_UNIT = 1e5  # arm lengths between points, beyond which no wrong unit explains them


def initial_values(model: Model, data: Measurements) -> Array:
    """Values of all parameters, places and markers from the data, the rest nominal, shape (p,).

    Each instrument, and a tracker at each of its stations, takes the markers as those before it found
    them. It is placed by the markers on one tip, those that it reads most, and then finds the others.
    """
    values = model.initial
    frames = forward(model.robot, data.poses.q)
    markers, free = model.markers.copy(), free_components(model)
    if not free.any() and not len(model.where(Base)):
        return values
    for instrument, part in model.readout.channels.blocks:
        bases = {
            e.where if instrument.sites else e.station: s
            for e, s in model.parts
            if isinstance(e, Base) and e.of.name == instrument.name
        }
        read = instrument.read_of(len(markers))
        on = model.marker_frames[read].reshape(-1, instrument.each)[:, 0]
        placed = set[int | str | None]()
        for station, tip, here in _sessions(instrument, data, part, on):
            own = data.take(here)
            start = instrument.start(
                own.readings[:, part, : instrument.rows],
                own.seen[:, part] & (on == tip),
                Nominal(
                    *_tip_before(model, instrument, frames, tip, here),
                    markers[read],
                    free[read],
                    not bases,
                ),
            )
            told = _of_room(model)[bases[station]] if station in bases else np.zeros(0, dtype=bool)
            moved = start.place[told] - values[bases[station]][told] if told.any() else start.place
            lengths = np.abs([*moved, *(start.markers - markers[read]).ravel()])
            if _room(model, data) < np.nan_to_num(lengths, nan=np.inf).max(initial=0.0):
                continue  # readings that tell nothing leave the guess
            markers[read] = start.markers
            free[read] &= ~start.told
            if station in bases and station not in placed:
                values[bases[station]] = start.place
            placed.add(station)
    for effect, part in model.parts:
        if isinstance(effect, Tool):
            values[part] = effect.values_at((markers - model.markers)[effect.markers])
    return values


def _tip_before(
    model: Model, instrument: Instrument, frames: Frames, tip: int, here: Mask
) -> tuple[Array, Array]:
    """Axes (m, 3, 3) and origins (m, 3), m, of a tip, by the base or the link under an instrument."""
    R, o = frames.R[here, tip], frames.o[here, tip]
    if instrument.seat is None:
        return R, o
    under = model.marker_frames[instrument.seat.start]
    back = np.swapaxes(frames.R[here, under], -1, -2)
    return back @ R, rotate(back, o - frames.o[here, under])


def missed_by(model: Model, data: Measurements, values: Array) -> Array:
    """How far the readings of each pose lie from where they are predicted, RMS, shape (m,), m."""
    off = model.off(values, data)
    return np.asarray(np.sqrt((off**2).sum(axis=(1, 2)) / np.maximum(data.seen.sum(axis=1), 1)))


def strayed(model: Model, data: Measurements, start: Array, values: Array) -> Mask:
    """Which values (p,) ran away from ``start``: places out of the room, others to absurd sizes."""
    limits = _ABSURD * model.sizes
    limits[_of_room(model)] = _room(model, data)
    return np.asarray(~(np.abs(values - start) <= limits))


def _room(model: Model, data: Measurements) -> float:
    """How far from its guess anything may be, m."""
    channels = model.readout.channels
    read = np.abs(data.readings[data.seen[..., None] & channels.lengths])
    return _ROOM * model.robot.reach + (float(read.max(initial=0.0)) if channels.metric else 0.0)


def _of_room(model: Model) -> Mask:
    """Which values (p,) say where things are, unlike those of a lens, which no room holds."""
    found = np.zeros(len(model.parameters), dtype=bool)
    placed = model.where(Base, Tool)
    found[placed] = [model.parameters[i].unit in ("mm", "mrad") for i in placed]
    return found


def _sessions(
    instrument: Instrument, data: Measurements, part: slice, on: IntArray
) -> list[tuple[int | str | None, int, Mask]]:
    """Stations or sites of an instrument, a tip that it reads there, and poses: those with most first.

    on : ndarray of int, shape (C,), the frame of the tip of each reading
    """
    seen, every = data.seen[:, part], np.ones(len(data.poses), dtype=bool)
    places: list[tuple[int | str | None, Mask]] = [(None, every)]
    if sites := instrument.sites:
        places = [(name, data.poses.touching(name, sites)) for name in sites]
    elif instrument.has_stations:
        places = [(s, data.poses.station == s) for s in range(len(data.poses.stations))]
    found = [
        (place, tip, here & seen[:, on == tip].any(axis=1))
        for place, here in places
        for tip in np.unique(on).tolist()
    ]
    found.sort(key=lambda own: -int(own[2].sum()))
    return [own for own in found if own[2].any()]


def whitening(cell: Cell, model: Model, values: Array, data: Measurements) -> Array:
    """Weights of the readings, shape (m, C, r, r); zero for hidden markers.

    A tracker's range is from where the cell says it stands, else from the origin of its readings.
    Raises CalibError where it stands at one place and the data have several stations.
    """
    if len(data.poses.stations) > 1 and any(i.fixed for i in cell.instruments):
        raise CalibError(
            "[instrument] position_mm holds for one station and the data have "
            f"{len(data.poses.stations)}; take it out, and ranges count from each station's origin"
        )
    W = model.readout.whitening(values, data.poses, data.readings, data.sigma)
    return W * data.seen[..., None, None]


def check_counts(model: Model, data: Measurements, share: float = 1.0) -> None:
    """Refuse what no choice of so few poses could determine.

    A reading of M markers on a tip fixes at most 3, 5 or 6 rigid coordinates (M = 1, 2, more), that of
    a body 6; the shape of the set of markers and bodies is common to all readings.
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
    # How many numbers say where the markers and bodies are on their tips.
    bodies = [e for e in model.effects if isinstance(e, Body)]
    rigid = coordinates = 0
    channels = model.readout.channels
    read = np.concatenate([i.read_of(len(model.markers)) for i in channels.instruments])
    for _, riding in model.by_tip:
        markers = np.intersect1d(riding, read)
        own = sum(body.marker in markers for body in bodies)
        numbers = 3 * (len(markers) - 3 * own) + 6 * own
        rigid += {3: 3, 6: 5}.get(numbers, 6) if len(markers) < 3 else 6
        coordinates += numbers
    shape = coordinates - rigid if len(model.where(Tool)) else 0
    measured = int(data.seen.any(axis=1).sum())
    placed = sum(
        len(e.parameters) for e in model.effects if isinstance(e, Base) and not e.of.has_stations
    )
    numbers = int((data.seen * channels.rows).sum())
    known = model.prior_rows
    equations = min(numbers, rigid * measured + shape + placed) + known
    return equations, rigid, shape + known


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
