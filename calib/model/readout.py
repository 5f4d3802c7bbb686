"""From points to what the instruments read of them, channel by channel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.readings import PartEffect, ReadingEffect
from calib.effects.tool_base import Base
from calib.effects.tuned import at_rest
from calib.instruments import Channels, Instrument
from calib.instruments.protocol import Linear
from calib.instruments.riding import moves_seen, seen_from
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class Readout:
    """The instruments of a model, where they stand, and what else changes their rows.

    bases, disturbing, loose : each effect and where its parameters stand in the values
    noise_scales : dict, instrument -> actual over stated noise, where it is known to differ
    """

    channels: Channels
    bases: tuple[tuple[Base, slice], ...]
    disturbing: tuple[tuple[ReadingEffect, slice], ...]
    loose: tuple[tuple[PartEffect, slice], ...] = ()
    noise_scales: Mapping[str, float] = field(default_factory=dict)

    @property
    def instruments(self) -> tuple[Instrument, ...]:
        return self.channels.instruments

    @property
    def even(self) -> float | None:
        """The standard deviation of every number, None where one does not say it all."""
        return self.instruments[0].even if len(self.instruments) == 1 else None

    def placed(self, instruments: Iterable[Instrument], values: Array) -> tuple[Instrument, ...]:
        """Instruments where these values (p,) put them."""
        places = {base.where: values[part] for base, part in self.bases}
        return tuple(i.found_at(places[i.name]) if i.name in places else i for i in instruments)

    def read(self, values: Array, poses: Poses, points: Array) -> Array:
        """Readings (..., m, C, r) of points (..., m, M, 3), m, in base axes."""
        rows = (self._rows(i, values, poses, points) for i in self.instruments)
        return self._side_by_side(rows, -1)

    def _rows(self, instrument: Instrument, values: Array, poses: Poses, points: Array) -> Array:
        place, seen = self._place(instrument, values, poses), seen_from(instrument, points)
        by_pose, own = _pose_by_pose(place, _of(instrument, seen, -2))
        rows = instrument.read(by_pose, own)
        rows = rows if by_pose is not place else rows[..., 0, :, :]
        for effect, part in self._disturbing(instrument):
            if not at_rest(effect, values[..., part]):
                rows, _, _ = effect.linearise(values[..., part], poses, rows)
        return rows

    def linearise(
        self, values: Array, poses: Poses, points: Array, J: Array
    ) -> tuple[Array, Array]:
        """Readings (..., m, C, r) and their derivatives (..., m, C, r, p).

        J : ndarray, shape (..., m, M, 3, p), those of the points; overwritten
        """
        pairs = [self._columns(i, values, poses, points, J) for i in self.instruments]
        rows, columns = zip(*pairs, strict=True)
        return self._side_by_side(rows, -1), self._side_by_side(columns, -2)

    def _columns(
        self, instrument: Instrument, values: Array, poses: Poses, points: Array, J: Array
    ) -> tuple[Array, Array]:
        J, points = moves_seen(instrument, points, J), seen_from(instrument, points)
        moved = _of(instrument, J, -3)
        moved = moved.copy() if len(self.instruments) > 1 and moved is J else moved
        place = self._place(instrument, values, poses)
        linear = _linearised(instrument, place, _of(instrument, points, -2))
        J = moved if linear.by_points is None else _followed(linear.by_points, moved)
        u = len(instrument.unknowns)
        for here, part in self._stands(instrument, poses):
            if here.all():
                J[..., part] = linear.by_place[..., :u]
            else:
                J[..., here, :, :, part] = linear.by_place[..., here, :, :, :u]
        for loose, part in self._loose_of(instrument):
            response = loose.response(poses, values[..., part])
            numbers, by = _loosened(loose, instrument, poses, response)
            J[..., part] = linear.by_place[..., u:][..., numbers] @ by[..., None, :, :]
        rows = linear.rows
        for effect, part in self._disturbing(instrument):
            rows, turn, by_effect = effect.linearise(values[..., part], poses, rows)
            J = J if at_rest(effect, values[..., part]) else turn @ J
            J[..., part] = by_effect
        return rows, J

    def follow(self, values: Array, poses: Poses, points: Array, moved: Array) -> Array:
        """How readings follow displacements (m, M, 3, k) of points (m, M, 3), m, shape (m, C, r, k)."""

        def one(instrument: Instrument) -> Array:
            place = self._place(instrument, values, poses, loose=False)
            seen = _of(instrument, seen_from(instrument, points), -2)
            by_points = _linearised(instrument, place, seen).by_points
            by = _of(instrument, moves_seen(instrument, points, moved), -3)
            return by if by_points is None else _followed(by_points, by)

        return self._side_by_side(map(one, self.instruments), -2)

    def footprint(self, values: Array, poses: Poses, points: Array, seen: Mask) -> float:
        """Metres at the points to one unit of the readings, RMS over those that are seen.

        points : ndarray, shape (m, M, 3), m, base axes; seen : ndarray of bool, shape (m, C)
        """
        moved = np.broadcast_to(np.eye(3), (*points.shape, 3)).copy()
        for seat in self.channels.seats:
            moved[:, seat] = 0.0  # what looks on stays where it is
        squares = (self.follow(values, poses, points, moved)[seen] ** 2).sum(axis=(-1, -2))
        mean = float(squares.mean()) / self.channels.width
        return 1.0 / float(np.sqrt(mean)) if mean else 1.0  # what sees turns alone: at a metre

    def whitening(self, values: Array, poses: Poses, readings: Array, sigma: Array) -> Array:
        """Whitening matrices of readings (..., m, C, r), shape (..., m, C, r, r).

        sigma : ndarray, shape (m, C), overriding standard deviation of a reading, NaN for none
        """

        def one(instrument: Instrument, part: slice) -> Array:
            place = self._place(instrument, values, poses, loose=False)
            rows = readings[..., part, : instrument.rows]
            by_pose, each = _pose_by_pose(place, rows)
            own = sigma[..., part] if by_pose is not place else sigma[..., None, part]
            W = instrument.whitening(by_pose, each, own)
            W = W if by_pose is not place else W[..., 0, :, :, :]
            return W / self.noise_scales.get(instrument.name, 1.0)

        return self._side_by_side((one(i, part) for i, part in self.channels.blocks), -2, -1)

    def rescaled(self, weights: Array, scales: Mapping[str, float]) -> Array:
        """Whitening matrices (..., m, C, r, r) of instruments whose noise is so many times as large."""
        out = weights.copy()
        for instrument, part in self.channels.blocks:
            out[..., part, :, :] /= scales.get(instrument.name, 1.0)
        return out

    def _disturbing(self, instrument: Instrument) -> list[tuple[ReadingEffect, slice]]:
        return [(e, part) for e, part in self.disturbing if e.changes(instrument)]

    def _loose_of(self, instrument: Instrument) -> list[tuple[PartEffect, slice]]:
        """What comes loose of an instrument, or of what it looks at."""
        return [(e, part) for e, part in self.loose if e.where in instrument.parts]

    def _stands(self, instrument: Instrument, poses: Poses) -> list[tuple[Mask, slice]]:
        """At which poses (m,) it stands where which of the values say; nothing where that is known."""
        stands, left = [], np.ones(len(poses), dtype=bool)
        for base, part in self.bases:
            if base.of.name == instrument.name:
                here = left if base.station is None else poses.station == base.station
                if base.of.sites:
                    here = poses.touching(base.where, base.of.sites)
                left = left & ~here
                stands += [(here, part)] if here.any() else []
        return stands

    def _place(
        self, instrument: Instrument, values: Array, poses: Poses, loose: bool = True
    ) -> Array:
        """Where it stands at each pose, (..., m, u), (..., 1, u) where it stays; zero where known.

        loose : whether what came loose follows, (..., m, u + n)
        """
        stands, u = self._stands(instrument, poses), len(instrument.unknowns)
        parts = self._loose_of(instrument) if loose else []
        if len(stands) == 1 and stands[0][0].all() and not parts:
            return values[..., None, stands[0][1]]
        n = max(part.stop for part in instrument.parts.values()) if parts else 0
        shape = (len(poses) if stands or parts else 1, u + n)
        place = np.zeros((*values.shape[:-1], *shape))
        for here, part in stands:
            place[..., here, :u] = values[..., None, part]
        for effect, part in parts:
            numbers, by = _loosened(
                effect, instrument, poses, effect.amounts(poses, values[..., part])[..., None]
            )
            place[..., u + numbers.start : u + numbers.stop] += by[..., 0]
        return place

    def _side_by_side(self, parts: Iterable[Array], *row_axes: int) -> Array:
        """The channels of the instruments side by side, rows filled up with zeros."""
        first, *others = parts
        if not others:
            return first
        width = self.channels.width
        filled = []
        for part in (first, *others):
            shape = list(part.shape)
            for axis in row_axes:
                shape[axis] = width
            out = np.zeros(shape)
            out[tuple(slice(size) for size in part.shape)] = part
            filled.append(out)
        # The channels' axis comes before that of the rows.
        return np.concatenate(filled, axis=min(row_axes) - 1)


def _loosened(
    effect: PartEffect, instrument: Instrument, poses: Poses, by: Array
) -> tuple[slice, Array]:
    """The numbers of an instrument that an effect moves, and by what (..., m, b, k), where it acts."""
    first, site = instrument.parts[effect.where].start, effect.site(instrument)
    here = np.ones(len(poses)) if site is None else poses.touching(site, instrument.sites)
    numbers = slice(first + effect.numbers.start, first + effect.numbers.stop)
    return numbers, by * here[:, None, None]


def _pose_by_pose(place: Array, rows: Array) -> tuple[Array, Array]:
    """A place (..., m, u) with its rows (..., m, C, k) as m batches of one pose.

    One that holds at every pose, (..., 1, u), comes back as (..., u) with the rows as they are.
    """
    if place.shape[-2] == 1 != rows.shape[-3]:
        return place[..., 0, :], rows
    return place, rows[..., None, :, :]


def _linearised(instrument: Instrument, place: Array, points: Array) -> Linear:
    """Rows (..., m, C, r) and their derivatives at places (..., m or 1, u)."""
    by_pose, own = _pose_by_pose(place, points)
    linear = instrument.linearise(by_pose, own)
    if by_pose is not place:
        return linear
    by_points = None if linear.by_points is None else linear.by_points[..., 0, :, :, :]
    return Linear(linear.rows[..., 0, :, :], by_points, linear.by_place[..., 0, :, :, :])


def _of(instrument: Instrument, a: Array, axis: int) -> Array:
    """What belongs to the markers that an instrument reads, which stand along an axis, by reading.

    A view, not to be written to, where all its readings are of the same markers.
    """
    each = instrument.each
    if instrument.markers is None and each == 1:
        return a
    read = instrument.read_of(a.shape[axis]).reshape(-1, each)
    alike = len(read) > 1 and bool((read == read[0]).all())
    taken = np.take(a, (read[0] if alike else read.ravel()), axis=axis)
    shape = [*taken.shape]
    shape[axis], shape[axis + 1] = shape[axis] // each, each * shape[axis + 1]
    taken = taken.reshape(shape)
    shape[axis] = len(read)
    return np.broadcast_to(taken, shape) if alike else taken


def _followed(by_points: Array, moved: Array) -> Array:
    """How readings (..., m, C, r) follow points (..., m, C, 3 k, p), of which C may be the same."""
    if moved.strides[-3] or not moved.shape[-3]:
        return np.asarray(by_points @ moved)
    *whole, r, _ = by_points.shape
    flat = by_points.reshape((*whole[:-1], whole[-1] * r, by_points.shape[-1]))
    found = flat @ moved[..., 0, :, :]
    return np.asarray(found.reshape((*found.shape[:-2], whole[-1], r, moved.shape[-1])))
