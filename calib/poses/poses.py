"""What is known of each reading before anything is measured: joints, loads, covariates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from calib.arrays import Array, IntArray, Mask, TextArray
from calib.errors import CalibError
from calib.result import Result

LAGS = 60.0 * np.array([5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, 180.0])
"""Time constants, s, at which it is known what follows the temperature late."""
_SAME_JOINTS = 1e-7  # rad or m; finer than any controller prints


@dataclass(frozen=True, eq=False, repr=False)
class Poses(Result):
    """The readings of a plan or of a data set, m of them.

    names : tuple of str, identifiers
    q : ndarray, shape (m, n), rad or m, joint values as read
    wrench : ndarray, shape (m, 6), N and N m, on the robot, moment about the tip frame's origin,
        both in base axes; zero where the file has none
    temperature : ndarray, shape (m,), degC, or None
    lagged : ndarray, shape (m, L), degC, what has followed the temperature with each of the L time
        constants ``LAGS`` since the session began, or None where nothing tells the way of temperature
    time : ndarray, shape (m,), s, or None
    start : float, s, the time of the first pose of the session, from which drift counts
    order : ndarray, shape (m,), number of the reading in the session, from zero, or None
    approach : ndarray, shape (m, n), sign of the last motion of each joint, or None
    approach_derived : bool, whether it follows from the order of measurement
    motion : ndarray, shape (m, n), rad or m, how far each joint went in the move before, by
        the order of measurement, or None
    torque : ndarray, shape (m, n), N m or N, that the arm measured along each joint, or None
    station : ndarray of int, shape (m,), index into ``stations``
    stations : tuple of str, names of the instrument's frames
    site : ndarray of str, shape (m,), which of the places of an instrument that has sites is touched,
        or None where nothing says it
    session : ndarray of str, shape (m,), the day of each reading, or None where all are of one
    load_mass : ndarray, shape (m,), kg hung at ``load_com`` (tip frame, m)
    """

    names: tuple[str, ...]
    q: Array
    wrench: Array
    station: IntArray
    load_mass: Array
    load_com: Array
    stations: tuple[str, ...] = ("base",)
    temperature: Array | None = None
    lagged: Array | None = None
    time: Array | None = None
    start: float = 0.0
    order: Array | None = None
    approach: Array | None = None
    approach_derived: bool = False
    motion: Array | None = None
    torque: Array | None = None
    site: TextArray | None = None
    session: TextArray | None = None

    def __post_init__(self) -> None:
        """Raise CalibError, naming the field, where not every pose has its row."""
        for name, own in self._arrays.items():
            if len(own) != len(self.names):
                raise CalibError(f"{name}: {len(own)} rows, and {len(self.names)} poses")
        if self.q.ndim != 2:
            raise CalibError(f"q: joint values have shape {self.q.shape}, expected (poses, joints)")

    def sentences(self) -> list[str]:
        return [f"Poses: {len(self)} of {self.q.shape[1]} joints, in rad and m"]

    def rows(self) -> list[dict[str, object]]:
        return [
            {"pose": name, **{f"q{k + 1}": v for k, v in enumerate(q)}}
            for name, q in zip(self.names, self.q.tolist(), strict=True)
        ]

    def __len__(self) -> int:
        return len(self.names)

    def take(self, index: Any) -> Poses:
        """The poses of an index array or mask, in that order."""
        chosen = np.arange(len(self))[index]
        changed: dict[str, Any] = {k: own[chosen] for k, own in self._arrays.items()}
        return replace(self, names=tuple(map(self.names.__getitem__, chosen.tolist())), **changed)

    def then(self, later: Poses) -> Poses:
        """These poses and others of the same session; what these do not have, none has.

        later : Poses, which have all that these have
        """
        both: dict[str, Any] = {
            k: np.concatenate([v, getattr(later, k)]) for k, v in self._arrays.items()
        }
        return replace(self, names=self.names + later.names, **both)

    @property
    def _arrays(self) -> dict[str, Any]:
        """What there is of each pose."""
        every = {own.name: getattr(self, own.name) for own in fields(self)}
        return {k: v for k, v in every.items() if isinstance(v, np.ndarray) and k != "load_com"}

    def touching(self, name: str, sites: tuple[str, ...]) -> Mask:
        """At which poses a place of an instrument with these sites is touched, shape (m,).

        Where nothing says it, the first one is; without sites the instrument reads all alike.
        """
        if not sites or self.site is None:
            return np.full(len(self), not sites or name == sites[0])
        return np.asarray(self.site == name)

    @property
    def elapsed(self) -> Array:
        """Time since the first pose of the session, shape (m,), s; zero where none is given."""
        return np.zeros(len(self)) if self.time is None else self.time - self.start

    @property
    def clock_unit(self) -> str:
        """Unit of :attr:`clock`, "s" or, where no time is given, "reading"."""
        return "s" if self.time is not None or self.order is None else "reading"

    @property
    def clock(self) -> Array:
        """Clock of the session, shape (m,): time since its first reading, s, else the reading's number.

        Zero where neither is known.
        """
        return self.elapsed if self.time is not None or self.order is None else self.order

    @property
    def clocked(self) -> bool:
        """Whether the order of measurement is known."""
        return self.time is not None or self.order is not None

    def clock_in(self, unit: str) -> Array | None:
        """The clock, shape (m,), None where it does not run in this unit."""
        return self.clock if self.clocked and unit == self.clock_unit else None

    @property
    def warming(self) -> Array:
        """Temperature above the 20 degC of the nominal model, shape (m,), K; zero if not given."""
        return np.zeros(len(self)) if self.temperature is None else self.temperature - 20.0

    def warming_late(self, lag: Array) -> Array:
        """The same of what follows with the nearest of ``LAGS``, shape (..., m); lag (...), s."""
        if self.lagged is None:
            return np.broadcast_to(self.warming, (*np.shape(lag), len(self)))
        nearest = np.abs(np.asarray(lag)[..., None] - LAGS).argmin(axis=-1)
        return np.asarray(self.lagged.T[nearest] - 20.0)

    @cached_property
    def configuration(self) -> IntArray:
        """Number of the configuration of each pose, shape (m,): poses with equal joints share it."""
        rounded = np.round(self.q / _SAME_JOINTS).astype(np.int64)
        _, group = np.unique(rounded, axis=0, return_inverse=True)
        return group.reshape(-1)

    @cached_property
    def repeated(self) -> IntArray:
        """Number of the repeat group of each pose, shape (m,): equal in all but time and heat."""
        return self.grouped([] if self.approach is None else list(self.approach.T))

    def grouped(self, keys: Sequence[Array]) -> IntArray:
        """Number of the group of each pose, shape (m,): equal joints, loads, station and keys."""
        every = [self.configuration, self.station, self.load_mass, *self.wrench.T, *keys]
        _, group = np.unique(np.column_stack(every), axis=0, return_inverse=True)
        return group.reshape(-1)


def poses_at(q: Array, names: Sequence[str] | None = None, **given: Any) -> Poses:
    """Poses at joint values q of shape (m, n), rad or m, without load; fields as keywords.

    Raises CalibError where a field has another number of rows.
    """
    m = len(q)
    blank: dict[str, Any] = {
        "names": tuple(f"p{i:04d}" for i in range(m)) if names is None else tuple(names),
        "q": np.asarray(q, dtype=float),
        "wrench": np.zeros((m, 6)),
        "station": np.zeros(m, dtype=int),
        "load_mass": np.zeros(m),
        "load_com": np.zeros(3),
    }
    return Poses(**(blank | given))


def hung(poses: Poses, mass: float, com: Sequence[float]) -> Poses:
    """The same poses with a mass [kg] hung at a point of the tip frame [m]."""
    return replace(poses, load_mass=np.full(len(poses), mass), load_com=np.array(com, dtype=float))


@dataclass(frozen=True, eq=False, repr=False)
class Measurements(Result):
    """What the instruments read at m poses, in C channels: a tracker has one for each marker.

    poses : Poses
    readings : ndarray, shape (m, C, r), rows of the instruments; of a tracker points [m] in the frame
        of each pose's station. Zero where hidden
    seen : ndarray of bool, shape (m, C)
    sigma : ndarray, shape (m, C), standard deviation of a row's numbers where the file gives one, else
        NaN
    warnings : tuple of str, what a reader should know about the file
    """

    poses: Poses
    readings: Array
    seen: Mask
    sigma: Array
    warnings: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        q: Array,
        points: Array,
        *,
        sigma: float | Array | None = None,
        seen: Mask | None = None,
        **given: Any,
    ) -> Measurements:
        """Measurements of plain arrays, in the order of measurement.

        q : ndarray, shape (m, n), rad or m
        points : ndarray, shape (m, M, 3), m, of every marker; or the rows of another instrument
        sigma : m, standard deviations, of shape (m, M) or one for all; the cell's without
        seen : ndarray of bool, shape (m, M), False for a hidden marker
        given : further fields of :class:`Poses`, as ``names``, ``wrench``, ``time``

        Raises CalibError, naming the argument, for another shape and for what is no number.
        """
        from calib.poses.moves import with_moves

        q, points = _numbers("q", q), _numbers("points", points)
        if points.ndim != 3:
            raise CalibError(f"points: have shape {points.shape}, expected (poses, markers, 3)")
        shape = points.shape[:2]
        shown = np.ones(shape, dtype=bool) if seen is None else np.asarray(seen, dtype=bool)
        stated = _numbers("sigma", np.nan if sigma is None else sigma)
        if stated.shape not in ((), shape):
            raise CalibError(f"sigma: has shape {stated.shape}, expected {shape} or one number")
        data = cls(
            with_moves(poses_at(q, **given)),
            points,
            shown,
            np.array(np.broadcast_to(stated, shape)),
        )
        data = replace(data, readings=np.where(shown[..., None], points, 0.0))
        data.check_numbers("q", "points")
        return data

    def __post_init__(self) -> None:
        """Raise CalibError, naming the field, where not every reading has its numbers."""
        m, shape = len(self.poses), self.seen.shape[-2:]
        if self.readings.shape[-3:-1] != shape or self.sigma.shape[-2:] != shape or shape[0] != m:
            raise CalibError(
                f"readings: have shape {self.readings.shape}, seen {self.seen.shape}, sigma "
                f"{self.sigma.shape}, of {m} poses; expected (poses, channels, numbers)"
            )

    def check_numbers(self, *named: str) -> None:
        """Raise CalibError where joint values or readings are no numbers; named : what to call them."""
        bad = ~np.isfinite(self.poses.q).all(axis=1), ~np.isfinite(self.readings).all(axis=(1, 2))
        for name, wrong in zip(named, bad, strict=True):
            if wrong.any():
                first = self.poses.names[int(np.flatnonzero(wrong)[0])]
                remedy = "leave the pose out, or hide what was not seen by seen"
                raise CalibError(f"{name}: pose {first!r} has a number that is none; {remedy}")

    def sentences(self) -> list[str]:
        read = f"{int(self.seen.sum())} readings of {self.seen.shape[1]} channels"
        return [f"Measurements: {len(self)} poses, {read}", *self.warnings]

    def rows(self) -> list[dict[str, object]]:
        return [
            {**row, "channels_read": int(count)}
            for row, count in zip(self.poses.rows(), self.seen.sum(axis=1), strict=True)
        ]

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def points(self) -> Array:
        """Points where instruments read them: of a tracker that reads alone (..., m, M, 3), m.

        Of whole poses their origins.
        """
        return self.readings[..., :3]

    @cached_property
    def read(self) -> IntArray:
        """Channels of each pose (m, c), those that were read first, c at most of one pose.

        All of them in their order where any pose has all.
        """
        most, every = int(self.seen.sum(axis=1).max(initial=0)), self.seen.shape[1]
        if most == every:
            return np.tile(np.arange(every), (len(self.seen), 1))
        return np.argsort(~self.seen, axis=1, kind="stable")[:, :most]

    def in_place(self, rows: Array, index: Any = slice(None)) -> Array:
        """Numbers (m, C, r) of rows (m, c r) of the channels that were read, zero of the others.

        index : of the poses that they are of, all by default
        """
        read, (_, C, r) = self.read[index], self.readings.shape[-3:]
        out = np.zeros((len(read), C, r))
        out[np.arange(len(read))[:, None], read] = rows.reshape((*read.shape, r))
        return out

    def only(self, channels: slice, rows: int) -> Measurements:
        """What some channels read, so many numbers each."""
        return replace(
            self,
            readings=self.readings[:, channels, :rows],
            seen=self.seen[:, channels],
            sigma=self.sigma[:, channels],
        )

    def take(self, index: Any) -> Measurements:
        """The measurements of an index array or mask over the poses."""
        return replace(
            self,
            poses=self.poses.take(index),
            readings=self.readings[index],
            seen=self.seen[index],
            sigma=self.sigma[index],
        )

    def then(self, later: Measurements) -> Measurements:
        """These readings and others, as of :meth:`Poses.then`."""
        return replace(
            self,
            poses=self.poses.then(later.poses),
            readings=np.concatenate([self.readings, later.readings]),
            seen=np.concatenate([self.seen, later.seen]),
            sigma=np.concatenate([self.sigma, later.sigma]),
        )

    def split(
        self, fraction: float, rng: np.random.Generator | int = 0
    ) -> tuple[Measurements, Measurements]:
        """Set aside a fraction of the configurations, whole: (kept, held out).

        fraction : float in (0, 1), of the configurations, rounded to at least one
        rng : a generator, or the seed of one

        Raises CalibError where nothing would be left, and for another fraction.
        """
        if not 0.0 < fraction < 1.0:
            raise CalibError(f"fraction: {fraction!r} is none; take one between 0 and 1")
        group = self.poses.configuration
        count = int(group.max()) + 1
        size = max(1, round(fraction * count))
        if size >= count:
            raise CalibError(
                f"a hold-out of {fraction:g} leaves none of {count} configurations to fit; take less"
            )
        held = np.random.default_rng(rng).permutation(count)[:size]
        out = np.isin(group, held)
        return self.take(~out), self.take(out)


def _numbers(name: str, values: object) -> Array:
    """An argument as numbers. Raises CalibError that names it where it holds none."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise CalibError(f"{name}: is a {type(values).__name__}, expected numbers") from None
