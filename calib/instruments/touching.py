"""Instruments whose numbers all err alike and by themselves, and their places from many starts."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arm.se3 import even_directions, rotate
from calib.arrays import Array, IntArray, Mask
from calib.instruments.placing import levers
from calib.instruments.protocol import Component, Instrument, Nominal, Start
from calib.solver import levenberg_marquardt

_MISSES = 5e-3  # m: what a nominal arm may miss, one standard deviation
_STRAYS = 5e-2  # m: and a first guess of a marker
_DIRECTIONS = 24
_ROOM = 10.0  # times as far as arm and readings go together: no place is farther


@dataclass(frozen=True, eq=False)
class Even(Instrument, ABC):
    """One standard deviation for every number, ``sigma``, m. Its place is sought by itself."""

    sigma: float = 1.0
    sought: ClassVar[bool] = True

    @property
    def numbers(self) -> tuple[Component, ...]:
        names = ("d",) if self.rows == 1 else ("x", "y", "z")
        return tuple(Component(name, "mm", 1e-3) for name in names)

    def row_of(self, entries: Array) -> Array:
        return np.pad(entries, ((0, 0), (0, self.rows - entries.shape[-1])))

    def entries_of(self, rows: Array) -> Array:
        return rows[..., : len(self.columns)]

    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        del place, rows
        own = np.where(np.isnan(sigma), self.sigma, sigma)
        return np.asarray(np.eye(self.rows) / own[..., None, None])

    @property
    def even(self) -> float | None:
        return self.sigma


@dataclass(frozen=True, eq=False)
class Surface(Even, ABC):
    """What the marker touches."""

    touches: ClassVar[bool] = True
    given_by: ClassVar[str] = "position_mm"

    @property
    def metric(self) -> bool:
        return False


def contacts(seen: Mask, arm: Nominal) -> tuple[IntArray, IntArray, Array]:
    """Pose and channel of each reading, and its nominal point (n, 3), m, in base axes."""
    pose, channel = np.nonzero(seen)
    points = rotate(arm.R_tip[pose], arm.markers[channel]) + arm.p_tip[pose]
    return pose, channel, points


def best(instrument: Instrument, rows: Array, seen: Mask, arm: Nominal, starts: Array) -> Start:
    """The place that fits the rows best, from several (S, u), and the markers that go with it.

    Markers of which nothing is known stay near their first guess where the rows do not tell them.
    """
    pose, channel, nominal = contacts(seen, arm)
    measured, R = rows[seen][:, None], arm.R_tip[pose]
    told = arm.free & np.any(seen, axis=0)[:, None]
    lever, u = levers(channel, R, told), len(instrument.unknowns)
    free = lever.shape[-1]

    def linearise(values: Array) -> tuple[Array, Array]:
        offsets = values[..., u:]
        points = rotate(R, arm.markers[channel]) + arm.p_tip[pose]
        points = points + np.einsum("ncf,...f->...nc", lever, offsets)
        found = instrument.linearise(values[..., :u], points[..., None, :])
        by_points = np.eye(3) if found.by_points is None else found.by_points
        by_free = np.broadcast_to(by_points @ lever[:, None], (*found.rows.shape, free))
        J = np.concatenate([found.by_place, by_free], axis=-1)
        off = measured - found.rows
        off = off.reshape((*off.shape[:-3], -1)) / _MISSES
        r = np.concatenate([off, -offsets / _STRAYS], -1)
        held = np.pad(np.eye(free) / _STRAYS, ((0, 0), (u, 0)))
        J = J.reshape((*off.shape, J.shape[-1])) / _MISSES
        return r, np.concatenate([J, np.broadcast_to(held, (*J.shape[:-2], *held.shape))], axis=-2)

    room = _ROOM * (np.linalg.norm(nominal, axis=-1).max() + np.abs(measured).max())
    values = np.pad(starts, ((0, 0), (0, free)))
    near = np.abs(values).max(axis=-1, initial=0.0) < room
    values = values[near] if near.any() else values
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = levenberg_marquardt(linearise, values, np.eye(values.shape[-1])).values
        # What readings tell of so little that it runs away stays where it began.
        inside = np.abs(moved).max(axis=-1, initial=0.0, keepdims=True) < room
        values = np.where(inside, moved, values)
        cost = np.sum(linearise(values)[0] ** 2, axis=-1)
    chosen = values[int(np.nanargmin(cost))]
    markers = arm.markers.copy()
    markers[told] += chosen[u:]
    return Start(chosen[:u], markers, told)


def around(points: Array, radius: float) -> Array:
    """Places (s, 3) at a distance from the middle of points (n, 3), m, evenly in all directions."""
    return np.asarray(points.mean(axis=0) + radius * even_directions(_DIRECTIONS))


def mirrored(place: Array, points: Array) -> Array:
    """A place (3,) seen in the plane that points (n, 3) lie in most: from one they hardly tell it."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle)[2][-1]
    return np.asarray(place - 2.0 * ((place - middle) @ normal) * normal)
