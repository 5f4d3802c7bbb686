"""Where the instruments stand and where the markers sit, from nothing but the readings."""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import forward
from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.instruments import Instrument
from calib.instruments.protocol import Nominal, Start
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

_ROOM = 10.0  # reaches of the arm
_ABSURD = 1e3  # plausible sizes


def initial_values(model: Model, data: Measurements) -> Array:
    """Values of all parameters, places and markers from the data, the rest nominal, shape (p,).

    Each instrument, and a tracker at each of its stations, takes the markers as those before it found
    them.
    """
    values = model.initial
    frames = forward(model.robot, data.poses.q)
    R_tip, p_tip = frames.R[:, -1], frames.o[:, -1]
    markers, free = model.markers.copy(), free_components(model)
    if not free.any() and not len(model.where(Base)):
        return values
    for instrument, part in model.readout.channels.blocks:
        bases = {
            e.where if instrument.sites else e.station: s
            for e, s in zip(model.effects, model.slices, strict=True)
            if isinstance(e, Base) and e.of.name == instrument.name
        }
        read = instrument.read_of(len(markers))
        for station, here in _sessions(instrument, data, part):
            own = data.take(here)
            start = instrument.start(
                own.readings[:, part, : instrument.rows],
                own.seen[:, part],
                Nominal(R_tip[here], p_tip[here], markers[read], free[read], not bases),
            )
            place = values[bases[station]] if station in bases else np.zeros(0)
            if _room(model, data) < _farthest(start, place, markers[read]):
                continue  # readings that tell nothing leave the guess
            markers[read] = start.markers
            free[read] &= ~start.told
            if station in bases:
                values[bases[station]] = start.place
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Tool):
            values[part] = effect.values_at((markers - model.markers)[effect.markers])
    return values


def strayed(model: Model, data: Measurements, start: Array, values: Array) -> Mask:
    """Which values (p,) ran away from ``start``: places out of the room, others to absurd sizes."""
    limits = _ABSURD * model.sizes
    for i in model.where(Base, Tool):  # a lens has pixels, which no room holds
        if model.parameters[i].unit in ("mm", "mrad"):
            limits[i] = _room(model, data)
    return np.asarray(~(np.abs(values - start) <= limits))


def _room(model: Model, data: Measurements) -> float:
    """How far from its guess anything may be, m."""
    channels = model.readout.channels
    read = np.abs(data.readings[data.seen[..., None] & channels.lengths])
    return _ROOM * model.robot.reach + (float(read.max(initial=0.0)) if channels.metric else 0.0)


def _farthest(start: Start, place: Array, markers: Array) -> float:
    """By how much the place, where there is one, or a marker left its guess; infinite for NaN."""
    placed = start.place - place if len(place) else place
    moved = np.abs(np.concatenate([placed, (start.markers - markers).ravel()]))
    return float(np.nan_to_num(moved, nan=np.inf).max(initial=0.0))


def _sessions(
    instrument: Instrument, data: Measurements, part: slice
) -> list[tuple[int | str | None, Mask]]:
    """Stations or sites of an instrument with their poses, that with the most poses first."""
    read = np.asarray(data.seen[:, part].any(axis=1))
    if sites := instrument.sites:
        touched = [(name, read & data.poses.touching(name, sites)) for name in sites]
        touched.sort(key=lambda own: -int(own[1].sum()))
        return [(name, here) for name, here in touched if here.any()]
    if not instrument.stationed:
        return [(None, read)] if read.any() else []
    counts = np.bincount(data.poses.station, minlength=len(data.poses.stations))
    found = [(int(s), data.poses.station == s) for s in np.argsort(-counts)]
    return [(s, here) for s, here in found if (here & read).any()]
