"""A ball in a socket: the marker is at one unknown point, reached from several directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from calib.arrays import Array, Mask
from calib.instruments.keys_table import KeysTable
from calib.instruments.placing import Apart, levers
from calib.instruments.protocol import (
    POINT,
    Instrument,
    Linear,
    Nominal,
    ReadingColumn,
    Start,
    Unknown,
)
from calib.instruments.touching import Surface, contacts
from calib.keys import Point, PositiveMetres, Written, key


@dataclass(frozen=True, eq=False)
class Socket(Surface):
    """``p - c``, read as zero; the place c is in base axes. sigma : float, m, of a coordinate."""

    kind: ClassVar[str] = "socket"
    rows: ClassVar[int] = 3
    loose: ClassVar[slice | None] = slice(0, 3)  # of its sites, the one that the pose names
    unknowns: ClassVar[tuple[Unknown, ...]] = POINT
    columns: ClassVar[tuple[ReadingColumn, ...]] = ()

    def linearise(self, place: Array, points: Array) -> Linear:
        moved = place.reshape((*place.shape[:-1], -1, 3)).sum(axis=-2)  # from where it stood
        rows = points - moved[..., None, None, :]
        by_place = np.tile(-np.eye(3), (1, place.shape[-1] // 3))
        return Linear(rows, None, np.broadcast_to(by_place, (*rows.shape, place.shape[-1])))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """``R_i u - c = -p_i`` is linear in the markers and c; one that is known leaves their mean."""
        del rows
        pose, channel, points = contacts(seen, arm)
        told = arm.free & np.any(seen, axis=0)[:, None]
        apart = Apart(levers(channel, arm.R_tip[pose], told), placed=False)
        back, offsets = apart.solved(-points)
        markers = arm.markers.copy()
        markers[told] += offsets
        return Start(-back, markers, told if apart.whole else np.zeros_like(told))


class SocketTable(KeysTable):
    """A socket: its keys in a cell."""

    rides = False
    makes = Socket
    kind: Literal["socket"]
    sigma: Annotated[PositiveMetres, key("sigma_mm")]
    """one standard deviation of a length"""
    standing: Annotated[
        Annotated[Array, Written(Point, np.atleast_2d)] | None, key("position_mm")
    ] = None
    """socket: its centre, in the base's frame"""


def joined_sockets(instruments: Sequence[Instrument]) -> tuple[Instrument, ...]:
    """Sockets of one uncertainty as one that stands elsewhere each time, behind all others.

    Foreseen where the places of all of them are given.
    """
    groups: dict[float, list[Socket]] = {}
    for own in instruments:
        if isinstance(own, Socket):
            groups.setdefault(own.sigma, []).append(own)
    joined = []
    for group in groups.values():
        given = [own.standing for own in group if own.standing is not None]
        whole = np.concatenate(given) if len(given) == len(group) else None
        sites = tuple(own.name for own in group) if len(group) > 1 else ()
        joined.append(replace(group[0], sites=sites, standing=whole))
    return (*(own for own in instruments if not isinstance(own, Socket)), *joined)
