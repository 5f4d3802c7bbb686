"""The channels of a set of instruments: what one reads of one marker, or of a few together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.instruments.protocol import Component, Instrument
from calib.keys import STRICT, Name, PositiveMetres, key


@dataclass(frozen=True, eq=False)
class Channels:
    """Channels side by side, those of the first instrument before those of the second.

    All are as wide as the widest row; numbers that a row does not have are zero, in readings,
    derivatives and weights alike. A tracker alone has one channel for each marker.

    markers : int, how many there are
    """

    instruments: tuple[Instrument, ...]
    markers: int

    def __len__(self) -> int:
        return len(self.marker)

    @property
    def blocks(self) -> Iterator[tuple[Instrument, slice]]:
        """Each instrument and its channels."""
        first = 0
        for instrument in self.instruments:
            last = first + len(instrument.read_of(self.markers)) // instrument.each
            yield instrument, slice(first, last)
            first = last

    @cached_property
    def marker(self) -> IntArray:
        """Position of the marker that each channel reads, of several the first, shape (C,)."""
        return np.concatenate([i.read_of(self.markers)[:: i.each] for i in self.instruments])

    @property
    def seats(self) -> list[slice]:
        """The markers that stand for links under instruments."""
        return [i.seat for i in self.instruments if i.seat is not None]

    def seats_kept(self, moved: Array, points: Array) -> Array:
        """Points (..., m, M, 3) that moved, those under instruments where they were: (m, M, 3).

        What is stated of how things scatter is how they do before whatever reads them.
        """
        if not self.seats:
            return moved
        kept = moved.copy()
        for seat in self.seats:
            kept[..., seat, :] = points[..., seat, :]
        return kept

    def names(self, markers: Sequence[str]) -> tuple[str, ...]:
        """What a table calls the reading of each channel, from the names of the markers."""
        return tuple(
            name
            for i, part in self.blocks
            for name in i.targets or (markers[j] for j in self.marker[part].tolist())
        )

    @cached_property
    def rows(self) -> IntArray:
        """How many independent numbers each has, shape (C,)."""
        each = [np.full(part.stop - part.start, len(i.numbers)) for i, part in self.blocks]
        return np.concatenate(each)

    @property
    def metric(self) -> bool:
        """Whether any number of any row is a length."""
        return any(len(i.lengths) for i in self.instruments)

    @property
    def shown(self) -> Component:
        """In what errors of all readings together are shown: a length where any is one."""
        numbers = [number for i in self.instruments for number in i.numbers]
        return next((n for n in numbers if n.unit == "mm"), numbers[0])

    @cached_property
    def lengths(self) -> Mask:
        """Which numbers of the readings are lengths, shape (C, r); all where none is."""
        found = np.zeros((len(self), self.width), dtype=bool)
        for instrument, part in self.blocks:
            found[part, instrument.lengths] = True
        return found if found.any() else ~found

    def numbers_each(self, seen: Mask) -> float:
        """How many numbers that are errors of length a reading has, 3 of a tracker; seen : (m, C)."""
        each = self.lengths.sum(axis=-1)
        counted = seen & (each > 0)
        return float((counted * each).sum() / max(1, counted.sum()))

    @property
    def width(self) -> int:
        """Numbers of the widest row."""
        return max(i.rows for i in self.instruments)


@dataclass(frozen=True)
class KnownDistance:
    """A length [m] known between two sockets or two markers, by their names: it reads no pose."""

    __pydantic_config__ = STRICT
    between: tuple[Name, Name]
    """their names"""
    length: Annotated[PositiveMetres, key("mm")]
    """the distance"""
    sigma: Annotated[PositiveMetres, key("sigma_mm")]
    """its standard deviation"""
