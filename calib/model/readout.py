"""From points to what the instruments read of them, channel by channel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.readings import PartEffect, ReadingEffect
from calib.effects.tool_base import Base
from calib.effects.tuned import at_rest
from calib.instruments import Channels, Instrument, Tracker
from calib.instruments.protocol import Linear
from calib.instruments.riding import moves_seen, seen_from
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class Stand:
    """Where an instrument stands at some poses.

    here : ndarray of bool, shape (m,), or None for all poses
    place : ndarray, shape (..., u), SI; part : where it is among the values, None where it is known
    """

    here: Mask | None
    place: Array
    part: slice | None

    def at(self, axis: int) -> tuple[Any, ...]:
        """The index of its poses in an array that has them along ``axis``, counted from the end."""
        return (..., self.here, *[slice(None)] * (-axis - 1))


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
        return self._side_by_side(
            (self._rows(i, values, poses, points) for i in self.instruments), -1
        )

    def _rows(self, instrument: Instrument, values: Array, poses: Poses, points: Array) -> Array:
        def read(stand: Stand, points: Array, *apart: Array) -> tuple[Array]:
            if not apart:
                return (instrument.read(stand.place, points),)
            place, each = _pose_by_pose(stand.place, points, apart[0])
            return (instrument.read(place, each)[..., 0, :, :],)

        given = [(_of(instrument, seen_from(instrument, points), -2), -3)]
        given += [(own, -2) for own in self._apart(instrument, values, poses)[:1]]
        (rows,) = self._at_stands(instrument, values, poses, read, given, [-3])
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
        found = [self._columns(i, values, poses, points, J) for i in self.instruments]
        rows, columns = zip(*found, strict=True)
        return self._side_by_side(rows, -1), self._side_by_side(columns, -2)

    def _columns(
        self, instrument: Instrument, values: Array, poses: Poses, points: Array, J: Array
    ) -> tuple[Array, Array]:
        def linearise(stand: Stand, points: Array, J: Array, *apart: Array) -> tuple[Array, Array]:
            if not apart:
                found = instrument.linearise(stand.place, points)
            else:
                place, each = _pose_by_pose(stand.place, points, apart[0])
                found = _of_each(instrument.linearise(place, each))
            J = J if found.by_points is None else _followed(found.by_points, J)
            known = stand.place.shape[-1]
            if stand.part is not None:
                J[..., stand.part] = found.by_place[..., :known]
            if apart:
                own = np.concatenate([np.arange(p.start, p.stop) for _, p in self._of(instrument)])
                J[..., own] = found.by_place[..., known:] @ apart[1][..., None, :, :]
            return found.rows, J

        J, points = moves_seen(instrument, points, J), seen_from(instrument, points)
        own = _of(instrument, J, -3)
        own = own.copy() if len(self.instruments) > 1 and own is J else own
        given = [(_of(instrument, points, -2), -3), (own, -4)]
        given += list(zip(self._apart(instrument, values, poses), (-2, -3), strict=False))
        rows, J = self._at_stands(instrument, values, poses, linearise, given, [-3, -4])
        for effect, part in self._disturbing(instrument):
            rows, turn, by_effect = effect.linearise(values[..., part], poses, rows)
            J = J if at_rest(effect, values[..., part]) else turn @ J
            J[..., part] = by_effect
        return rows, J

    def follow(self, values: Array, poses: Poses, points: Array, moved: Array) -> Array:
        """How readings follow displacements (m, M, 3, k) of points (m, M, 3), m, shape (m, C, r, k)."""

        def one(instrument: Instrument) -> Array:
            def follow(stand: Stand, points: Array, moved: Array) -> tuple[Array]:
                by_points = instrument.linearise(stand.place, points).by_points
                return (moved if by_points is None else _followed(by_points, moved),)

            own, by = seen_from(instrument, points), moves_seen(instrument, points, moved)
            given = [(_of(instrument, own, -2), -3), (_of(instrument, by, -3), -4)]
            return self._at_stands(instrument, values, poses, follow, given, [-4])[0]

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
            def whitening(stand: Stand, rows: Array, sigma: Array) -> tuple[Array]:
                return (instrument.whitening(stand.place, rows, sigma),)

            rows = readings[..., part, : instrument.rows]
            given = [(rows, -3), (sigma[..., part], -2)]
            found = self._at_stands(instrument, values, poses, whitening, given, [-4])[0]
            return found / self.noise_scales.get(instrument.name, 1.0)

        return self._side_by_side((one(i, part) for i, part in self.channels.blocks), -2, -1)

    def rescaled(self, weights: Array, scales: Mapping[str, float]) -> Array:
        """Whitening matrices (..., m, C, r, r) of instruments whose noise is so many times as large."""
        out = weights.copy()
        for instrument, part in self.channels.blocks:
            out[..., part, :, :] /= scales.get(instrument.name, 1.0)
        return out

    def beams(self, instrument: Tracker, values: Array, poses: Poses, rows: Array) -> Array:
        """From a tracker to the points of its rows (m, C, r), shape (m, C, 3), m, station axes."""

        def beams(stand: Stand, rows: Array) -> tuple[Array]:
            return (instrument.beams(stand.place, rows),)

        own = rows[..., : instrument.rows]
        return self._at_stands(instrument, values, poses, beams, [(own, -3)], [-3])[0]

    def _disturbing(self, instrument: Instrument) -> Iterator[tuple[ReadingEffect, slice]]:
        return ((e, part) for e, part in self.disturbing if e.changes(instrument))

    def _of(self, instrument: Instrument) -> list[tuple[PartEffect, slice]]:
        """What comes loose of an instrument, or of what it looks at."""
        return [(e, part) for e, part in self.loose if e.where in instrument.parts]

    def _apart(self, instrument: Instrument, values: Array, poses: Poses) -> list[Array]:
        """How far its parts have come loose, (..., m, n), and the derivatives (..., m, n, p).

        The latter by the parameters of all that does so; nothing where none may.
        """
        loose, parts = self._of(instrument), instrument.parts
        if not loose:
            return []
        n = max(part.stop for part in parts.values())
        by, columns = np.zeros((*values.shape[:-1], len(poses), n)), []
        for effect, part in loose:
            first, site = parts[effect.where].start, effect.site(instrument)
            here = np.ones(len(poses)) if site is None else poses.touching(site, instrument.sites)
            at = slice(first + effect.numbers.start, first + effect.numbers.stop)
            own = np.zeros((*by.shape, part.stop - part.start))
            own[..., at, :] = effect.response(poses, values[..., part]) * here[:, None, None]
            by[..., at] += effect.amounts(poses, values[..., part]) * here[:, None]
            columns.append(own)
        return [by, np.concatenate(columns, axis=-1)]

    def _stands(self, instrument: Instrument, values: Array, poses: Poses) -> Iterator[Stand]:
        """Where it stands at which poses; at zero where nothing is unknown."""
        left = np.ones(len(poses), dtype=bool)
        for base, part in self.bases:
            if base.of.name == instrument.name:
                here = left if base.station is None else poses.station == base.station
                if base.of.sites:
                    here = poses.touching(base.where, base.of.sites)
                left = left & ~here
                if here.any():
                    yield Stand(None if here.all() else here, values[..., part], part)
        if left.any():
            rest = np.zeros((*values.shape[:-1], len(instrument.unknowns)))
            yield Stand(None if left.all() else left, rest, None)

    def _at_stands(
        self,
        instrument: Instrument,
        values: Array,
        poses: Poses,
        work: Callable[..., tuple[Array, ...]],
        given: list[tuple[Array, int]],
        axes: list[int],
    ) -> tuple[Array, ...]:
        """What ``work`` makes of arrays at each stand, put together again.

        given : arrays, and their axis of the poses; axes : that of the arrays that come back, all
            counted from the end
        """
        stands = list(self._stands(instrument, values, poses))
        if len(stands) == 1:
            return work(stands[0], *(a for a, _ in given))
        parts = [work(stand, *(a[stand.at(axis)] for a, axis in given)) for stand in stands]
        whole = []
        for axis, own in zip(axes, zip(*parts, strict=True), strict=True):
            shape = list(own[0].shape)
            shape[axis] = len(poses)
            out = np.empty(shape)
            for stand, part in zip(stands, own, strict=True):
                out[stand.at(axis)] = part
            whole.append(out)
        return tuple(whole)

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


def _pose_by_pose(place: Array, points: Array, apart: Array) -> tuple[Array, Array]:
    """A place (..., u) of its own for every pose, with what came loose (..., m, n), and its points."""
    batch = np.broadcast_shapes(place.shape[:-1], apart.shape[:-2])
    shape = (*batch, apart.shape[-2])
    each = np.broadcast_to(place[..., None, :], (*shape, place.shape[-1]))
    own = np.broadcast_to(apart, (*shape, apart.shape[-1]))
    return np.concatenate([each, own], axis=-1), points[..., None, :, :]


def _of_each(found: Linear) -> Linear:
    """What was found pose by pose, poses side by side."""
    by_points = None if found.by_points is None else found.by_points[..., 0, :, :, :]
    return Linear(found.rows[..., 0, :, :], by_points, found.by_place[..., 0, :, :, :])


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
