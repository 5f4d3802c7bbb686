"""The instruments of a cell file: tables of millimetres to objects in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.files.schema import (
    BodyTable,
    CellFile,
    InstrumentTable,
    MpeSigma,
    PolarSigma,
    PoseTable,
    Sigma,
)
from calib.instruments import Instrument, Pose, Tracker
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
    """All of them, in the order of the file."""
    if table.instrument is not None:
        return (_tracker(table.instrument, "instrument", None),)
    own = tuple(range(len(markers))) if bodies.first else None
    found: list[Instrument] = []
    for name, entry in table.instruments.items():
        if isinstance(entry, PoseTable):
            found.append(_pose(entry, name, bodies))
        else:
            found.append(_tracker(entry, name, own))
    return tuple(found)


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
