"""The instruments of a cell file: tables of millimetres to objects in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.errors import InputError
from calib.files.schema import (
    BodyTable,
    CellFile,
    DistanceTable,
    InstrumentTable,
    MpeSigma,
    PlaneTable,
    PolarSigma,
    PoseTable,
    Sigma,
    SocketTable,
    SphereTable,
)
from calib.instruments import (
    Distance,
    Instrument,
    KnownDistance,
    Plane,
    Pose,
    Socket,
    Sphere,
    Tracker,
)
from calib.instruments.pose import CORNERS, corners_of
from calib.noise import Noise

_MM = 1e-3
_URAD = 1e-6


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of a cell as markers that follow its own.

    first : dict, name -> position of its origin; names : tuple of str, of all of these markers
    markers : ndarray, shape (3 b, 3), m, tip frame
    """

    first: Mapping[str, int]
    names: tuple[str, ...]
    markers: Array


def bodies_of(table: Mapping[str, BodyTable], markers: int) -> Bodies:
    """The bodies after so many markers; one of which nothing is said is guessed at the tip frame."""
    first = {name: markers + CORNERS * i for i, name in enumerate(table)}
    names = tuple(name + end for name in table for end in ("", ":x", ":y"))
    placed = [_corners(body) for body in table.values()]
    return Bodies(first, names, np.concatenate([np.zeros((0, 3)), *placed]))


def _corners(table: BodyTable) -> Array:
    T = from_xyz_rpy(np.array(table.position_mm) * _MM, np.radians(table.rpy_deg))
    return corners_of(T[:3, :3], T[:3, 3])


def instruments_of(
    table: CellFile, markers: Sequence[str], bodies: Bodies
) -> tuple[Instrument, ...]:
    """All of them; sockets of one uncertainty are one instrument that stands elsewhere each time."""
    if table.instrument is not None:
        return (_tracker(table.instrument, "instrument", None),)
    own = tuple(range(len(markers))) if bodies.first else None
    placed = "base" in table.model.effects
    found: list[Instrument] = []
    groups: dict[float, list[str]] = {}
    for name, entry in table.instruments.items():
        if isinstance(entry, PoseTable):
            found.append(_pose(entry, name, bodies))
        elif isinstance(entry, InstrumentTable):
            found.append(_tracker(entry, name, own))
        elif isinstance(entry, SocketTable):
            groups.setdefault(entry.sigma_mm, []).append(name)
        else:
            found.append(replace(_touching(entry, placed), name=name, markers=own))
    for sigma, names in groups.items():
        sites = tuple(names) if len(names) > 1 else ()
        found.append(Socket(names[0], own, sites, sigma * _MM))
    return tuple(found)


def _touching(table: DistanceTable | PlaneTable | SphereTable, placed: bool) -> Instrument:
    """placed : whether the model has places of instruments: what is given of them is a guess."""
    sigma = table.sigma_mm * _MM
    if isinstance(table, DistanceTable):
        anchor = None if table.anchor_mm is None else np.array(table.anchor_mm) * _MM
        known = anchor is not None and not placed
        return Distance(sigma=sigma, anchor=anchor, known=known, offset=table.offset)
    if isinstance(table, PlaneTable):
        return Plane(sigma=sigma)
    radius = None if table.radius_mm is None else table.radius_mm * _MM
    return Sphere(sigma=sigma, radius=radius)


def _tracker(table: InstrumentTable, name: str, reads: tuple[int, ...] | None) -> Tracker:
    stands = None if table.position_mm is None else np.array(table.position_mm) * _MM
    return Tracker(name=name, markers=reads, noise=_noise(table.sigma_mm), stands=stands)


def _pose(table: PoseTable, name: str, bodies: Bodies) -> Pose:
    reads = tuple(i for first in bodies.first.values() for i in range(first, first + CORNERS))
    units = np.repeat([_MM, _URAD], 3)
    if table.covariance is not None:
        covariance = np.array(table.covariance) * np.outer(units, units)
    else:
        sigma = np.repeat([table.sigma_mm or math.nan, table.sigma_urad or math.nan], 3)
        covariance = np.diag((sigma * units) ** 2)
    alone = float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))
    return Pose(name=name, markers=reads, noise=Noise.isotropic(alone), covariance=covariance)


def _noise(sigma: Sigma) -> Noise:
    if isinstance(sigma, PolarSigma):
        return Noise(
            sigma.range_mm * _MM,
            sigma.transverse_mm * _MM,
            sigma.range_mm_per_m * _MM,
            sigma.transverse_mm_per_m * _MM,
        )
    if isinstance(sigma, MpeSigma):
        return Noise.maximum_permissible(
            sigma.mpe_mm * _MM, sigma.mpe_mm_per_m * _MM, sigma.divisor
        )
    return Noise.isotropic(sigma * _MM)


def known_distances(path: Path, table: CellFile) -> tuple[KnownDistance, ...]:
    """Those of the cell. Raises InputError where one is not between two sockets or two markers."""
    sockets = {name for name, own in table.instruments.items() if own.kind == "socket"}
    found = []
    for number, own in enumerate(table.known_distances):
        a, b = own.between
        alike = any(a in names and b in names for names in (sockets, set(table.markers_mm)))
        if a == b or not alike:
            known = ", ".join([*sorted(sockets), *table.markers_mm][:12])
            raise InputError(
                path,
                f"known_distances.{number}.between",
                f"{a!r} and {b!r} are not two sockets or two markers of the cell",
                f"those are {known}",
            )
        found.append(KnownDistance((a, b), own.mm * _MM, own.sigma_mm * _MM))
    return tuple(found)
