"""An instrument makes rows of numbers, whose noise is known, from points of the arm.

An instrument reads points at each pose, each of them as a **row** of numbers: three coordinates, two
pixels, one distance. A reading may take several points of the tip together; three of them fix its
frame, which an instrument may read, or ride on. How it stands against the robot's base is unknown, its
**place**: nuisance beside the parameters, estimated without a guess. A new instrument is one file with

    unknowns            the coordinates of its place
    linearise           rows of points in base axes, their derivatives by the points and by the place
    whitening           from the covariance of a row; what the simulator adds follows from it
    start               the place, and the markers if they follow, from nothing but the rows
    columns             how a row stands in a table
    a KeysTable         its keys in a cell, below each what it means, and the instrument that they make

and two entries in ``calib.instruments``: an import and one in ``KINDS``.

Of C readings a pose the points are (m, C, 3), or (m, C, 3 k) where each takes k, the rows (m, C, r).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np

from calib.arrays import Array, IntArray, Mask

WORLD, TIP = "world", "tip"
"""Where things stand that ride on no link, and what a cell calls the robot's last one."""


class Unknown(NamedTuple):
    """One coordinate of a place: its name, the unit shown, that unit and a plausible size in SI."""

    name: str
    unit: str
    scale: float
    size: float


POINT = tuple(Unknown(c, "mm", 1e-3, 1e-2) for c in "xyz")
FRAME = (*POINT, *(Unknown(f"r{c}", "mrad", 1e-3, 1e-2) for c in "xyz"))
"""A point, and a frame, in base axes."""
ZERO, MOTION, SCALE = slice(0, 1), slice(0, 6), slice(6, 7)
"""Of a part that may come loose: a displacement in its own axes, and what it is too large by."""


class ReadingColumn(NamedTuple):
    """One number of a row in a table, ``<name>_<unit>`` with a unit of its quantity, if it has one.

    optional : whether column or number may be missing: it is zero then
    """

    name: str
    quantity: Literal["length", "pixel", "ratio"]
    optional: bool = False


class Component(NamedTuple):
    """One number of an error, field ``<name>_<unit>`` of each residual, and its unit in SI."""

    name: str
    unit: Literal["mm", "mrad", "px"]
    scale: float


class Linear(NamedTuple):
    """Rows (..., m, C, r) and their derivatives.

    by_points : ndarray, shape (..., m or 1, C or 1, r, 3 k), None for the identity
    by_place : ndarray, shape (..., m, C, r, u)
    """

    rows: Array
    by_points: Array | None
    by_place: Array


class Nominal(NamedTuple):
    """The arm before anything is known of it, at m poses.

    R_tip, p_tip : ndarray, shapes (m, 3, 3) and (m, 3), m, frame of the tip that carries what is read,
        in the axes of the base, or of the link under the instrument
    markers : ndarray, shape (C k, 3), m, that the instrument reads, in the tip frame; free : ndarray of
        bool, of the same shape, components of which nothing is known yet
    placed : whether the instrument's place is known: all zero
    """

    R_tip: Array
    p_tip: Array
    markers: Array
    free: Mask
    placed: bool


class Start(NamedTuple):
    """A place (u,), the markers (C k, 3), m, and which of their components follow from the rows."""

    place: Array
    markers: Array
    told: Mask


@dataclass(frozen=True, eq=False)
class Instrument(ABC):
    """One instrument of a cell.

    name : str, its own among those of the cell
    markers : tuple of int or None, positions of the markers that it reads, reading by reading; None for
        all of them
    sites : tuple of str, names of the cell where several are one that stands elsewhere from pose to
        pose, at one of them each time; none where it is one
    targets : tuple of str, what a table calls each reading, where that is not the marker's name
    seat : slice or None, the three markers that stand for the link on which it rides: whatever is said
        of the base's axes then goes for that link's (:mod:`calib.instruments.riding`)
    standing : ndarray, shape (u,), or (k, u) by sites, the place or its first numbers as far as the
        cell gives it; None where it does not
    rows : numbers of one reading; each : markers that one takes, k; columns : of a table
    stationed : whether it may stand elsewhere at other poses, a place for every station
    sought : whether its place is unknown even where the model has no base: nothing else gives it
    touches : whether it reads where the arm meets it alone: its poses are solved for, not drawn
    given_by : keys of a cell without which its readings cannot be foreseen; none where they can
    loose : numbers of a displacement in which it may come loose; None where it cannot
    """

    name: str = "instrument"
    markers: tuple[int, ...] | None = None
    sites: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    seat: slice | None = None
    standing: Array | None = None
    kind: ClassVar[str]
    rows: ClassVar[int]
    each: ClassVar[int] = 1
    columns: ClassVar[tuple[ReadingColumn, ...]]
    stationed: ClassVar[bool] = False
    sought: ClassVar[bool] = False
    touches: ClassVar[bool] = False
    given_by: ClassVar[str] = ""
    loose: ClassVar[slice | None] = None

    @property
    @abstractmethod
    def unknowns(self) -> tuple[Unknown, ...]:
        """The coordinates of its place."""

    @abstractmethod
    def linearise(self, place: Array, points: Array) -> Linear:
        """Rows and their derivatives of points (..., m, C, 3 k), m, in base axes; place : (..., u)."""

    @abstractmethod
    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        """Matrices W with ``W cov W^T = I`` for rows (..., m, C, r), shape (..., m, C, r, r).

        sigma : ndarray, shape (m, C), overriding standard deviation of a reading, NaN for none
        """

    @abstractmethod
    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """Place and markers under the nominal arm, without a guess.

        rows : ndarray, shape (m, C, r); seen : ndarray of bool, shape (m, C), at least one of them
        """

    def read(self, place: Array, points: Array) -> Array:
        """The rows (..., m, C, r) alone."""
        return self.linearise(place, points).rows

    # -- its numbers in a table and in results ---------------------------------------------------

    @property
    def numbers(self) -> tuple[Component, ...]:
        """What :meth:`shown` gives, in its order: as many as a reading has that are independent."""
        return tuple(Component(c.name, "mm", 1e-3) for c in self.columns if c.quantity == "length")

    @property
    def lengths(self) -> IntArray:
        """Positions in a row of the numbers whose errors are lengths, m."""
        return np.flatnonzero([number.unit == "mm" for number in self.numbers])

    def shown(self, measured: Array, off: Array) -> Array:
        """The error (..., k) of readings (..., r) that are ``off`` (..., r), as people read it, SI."""
        del measured
        return off

    def row_of(self, entries: Array) -> Array:
        """Rows (..., r) of what stands in the columns of a table (..., c), SI; NaN for nonsense."""
        return entries

    def entries_of(self, rows: Array) -> Array:
        """The way back."""
        return rows

    # -- where it stands and what it sees --------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """What the cell calls it: its own name, or those of its sites."""
        return self.sites or (self.name,)

    def name_at(self, site: str) -> str:
        """What the cell calls it where it stands at a site."""
        return site if site in self.sites else self.name

    @property
    def has_stations(self) -> bool:
        """Whether it stands elsewhere from station to station."""
        return self.stationed and self.seat is None

    def read_of(self, markers: int) -> IntArray:
        """Positions of the markers that it reads, of so many."""
        return np.arange(markers) if self.markers is None else np.array(self.markers, dtype=int)

    def guess_at(self, name: str) -> Array:
        """Where the one of its sites that has this name is taken to stand, (u,): known, or zero."""
        place = np.zeros(len(self.unknowns))
        if self.standing is not None:
            by_site = self.standing.ndim > 1
            given = self.standing[self.names.index(name)] if by_site else self.standing
            place[: len(given)] = given
        return place

    def found_at(self, place: Array) -> Self:
        """The same as it is foreseen once its place (u,) is known."""
        del place
        return self

    @property
    def belief(self) -> Array:
        """What is known of its place about zero beforehand, as rows of unit variance (k, u)."""
        return np.zeros((0, len(self.unknowns)))

    @property
    def parts(self) -> Mapping[str, slice]:
        """What effects may change from pose to pose, by its place in results.

        A place may have these numbers after its unknowns, zero at rest.
        """
        if self.loose is None:
            return {}
        return {f"{self.kind}:{name}": self.loose for name in self.names}

    @property
    def unforeseen(self) -> str:
        """What keeps its readings from being foreseen, and what to do; empty where nothing does."""
        if self.standing is not None or not self.given_by:
            return ""
        of = f" of {', '.join(self.sites)}" if self.sites else ""
        return f"where it stands is not known; give {self.given_by}{of} in the base's frame"

    @property
    def metric(self) -> bool:
        """Whether its readings hold a length: without any, an arm of twice the size reads the same."""
        return True

    @property
    def anchored(self) -> bool:
        """Whether the cell says where it stands, whatever else of its place is unknown."""
        return False

    @property
    def even(self) -> float | None:
        """The standard deviation of every number at any place, None where one does not say it all."""
        return None

    @property
    def fixed(self) -> bool:
        """Whether its noise depends on where it stands, and that is given once for all stations."""
        return False

    @property
    def position(self) -> Array | None:
        """Where it stands, shape (3,), m, base frame; None where that is not given."""
        return None
