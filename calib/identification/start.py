"""Where a search starts: instruments and markers placed from nothing but the readings, and weights."""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import Frames, forward
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.effects.tool_base import Base, Tool
from calib.errors import CalibError
from calib.instruments import Instrument
from calib.instruments.protocol import Nominal
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

_ROOM = 10.0  # reaches of the arm
_ABSURD = 1e3  # plausible sizes


def initial_values(model: Model, data: Measurements) -> Array:
    """Values of all parameters, places and markers from the data, the rest nominal, shape (p,).

    Each instrument, and a tracker at each of its stations, takes the markers as those before it found
    them. It is placed by the markers on one tip, those that it reads most, and then finds the others.
    """
    values, frames = model.initial, forward(model.robot, data.poses.q)
    markers, free = model.markers.copy(), free_components(model)
    if not free.any() and not len(model.where(Base)):
        return values
    placed, limit = _placed(model), _room(model, data)
    for instrument, part in model.readout.channels.blocks:
        bases = {
            e.where if instrument.sites else e.station: s
            for e, s in model.parts
            if isinstance(e, Base) and e.of.name == instrument.name
        }
        read = instrument.read_of(len(markers))
        on = model.marker_frames[read].reshape(-1, instrument.each)[:, 0]
        done = set[int | str | None]()
        for station, tip, here in _sessions(instrument, data, part, on):
            seat = _tip_before(model, instrument, frames, tip, here)
            readings, seen = data.readings[here][:, part, : instrument.rows], data.seen[here, part]
            nominal = Nominal(*seat, markers[read], free[read], not bases)
            start = instrument.start(readings, seen & (on == tip), nominal)
            at = bases.get(station, slice(0, 0))
            moved = (start.place - values[at])[placed[at]] if station in bases else start.place
            away = np.abs([*moved, *(start.markers - markers[read]).ravel()])
            if limit < np.nan_to_num(away, nan=np.inf).max(initial=0.0):
                continue  # readings that tell nothing leave the guess
            markers[read] = start.markers
            free[read] &= ~start.told
            if station in bases and station not in done:
                values[at] = start.place
            done.add(station)
    for effect, part in model.parts:
        if isinstance(effect, Tool):
            values[part] = effect.values_at((markers - model.markers)[effect.markers])
    return values


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
    sessions = [
        (place, tip, here & seen[:, on == tip].any(axis=1))
        for place, here in places
        for tip in np.unique(on).tolist()
    ]
    return sorted((s for s in sessions if s[2].any()), key=lambda s: -int(s[2].sum()))


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


def diverged(model: Model, data: Measurements, start: Array, values: Array) -> Mask:
    """Which values (p,) ran away from ``start``: places out of the room, others to absurd sizes."""
    limits = np.where(_placed(model), _room(model, data), _ABSURD * model.sizes)
    return np.asarray(~(np.abs(values - start) <= limits))


def _room(model: Model, data: Measurements) -> float:
    """How far from its guess anything may be, m."""
    channels = model.readout.channels
    read = np.abs(data.readings[data.seen[..., None] & channels.lengths])
    return _ROOM * model.robot.reach + (float(read.max(initial=0.0)) if channels.metric else 0.0)


def _placed(model: Model) -> Mask:
    """Which values (p,) say where things are, unlike those of a lens, which no room holds."""
    places = np.zeros(len(model.parameters), dtype=bool)
    at = model.where(Base, Tool)
    places[at] = [model.parameters[i].unit in ("mm", "mrad") for i in at]
    return places


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
