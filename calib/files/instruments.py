"""The instruments of a cell file, in SI."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.errors import InputError
from calib.files.schema import (
    AnyInstrument,
    CellFile,
    DistanceTable,
    InstrumentTable,
    MpeSigma,
    PlaneTable,
    PolarSigma,
    Sigma,
    SphereTable,
)
from calib.instruments import (
    Distance,
    Instrument,
    KnownDistance,
    Plane,
    Socket,
    Sphere,
    Tracker,
)
from calib.noise import Noise

_MM = 1e-3


def instruments_of(table: CellFile) -> tuple[Instrument, ...]:
    """All of them; sockets of one uncertainty are one instrument that stands elsewhere each time."""
    if table.instrument is not None:
        return (_tracker(table.instrument),)
    placed = "base" in table.model.effects
    found: list[Instrument] = []
    groups: dict[float, list[str]] = {}
    for name, own in table.instruments.items():
        if own.kind == "socket":
            groups.setdefault(own.sigma_mm, []).append(name)
        else:
            found.append(replace(_instrument(own, placed), name=name))
    for sigma, names in groups.items():
        sites = tuple(names) if len(names) > 1 else ()
        found.append(Socket(names[0], None, sites, sigma * _MM))
    return tuple(found)


def _instrument(table: AnyInstrument, placed: bool) -> Instrument:
    """placed : whether the model has places of instruments: what is given of them is a guess."""
    if isinstance(table, DistanceTable):
        anchor = None if table.anchor_mm is None else np.array(table.anchor_mm) * _MM
        known = anchor is not None and not placed
        sigma, offset = table.sigma_mm * _MM, table.offset
        return Distance(sigma=sigma, anchor=anchor, known=known, offset=offset)
    if isinstance(table, PlaneTable):
        return Plane(sigma=table.sigma_mm * _MM)
    if isinstance(table, SphereTable):
        radius = None if table.radius_mm is None else table.radius_mm * _MM
        return Sphere(sigma=table.sigma_mm * _MM, radius=radius)
    if isinstance(table, InstrumentTable):
        return _tracker(table)
    return Socket(sigma=table.sigma_mm * _MM)


def _tracker(table: InstrumentTable) -> Tracker:
    stands = None if table.position_mm is None else np.array(table.position_mm) * _MM
    return Tracker(noise=_noise(table.sigma_mm), stands=stands)


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
