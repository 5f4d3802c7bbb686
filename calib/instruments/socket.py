"""A ball in a socket: the marker is at one unknown point, reached from several directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array, Mask
from calib.instruments.even import POINT, Surface, contacts
from calib.instruments.protocol import Column, Linear, Nominal, Start, Unknown


@dataclass(frozen=True, eq=False)
class Socket(Surface):
    """``p - c``, read as zero; the place c is in base axes. sigma : float, m, of a coordinate."""

    kind: ClassVar[str] = "socket"
    rows: ClassVar[int] = 3
    unknowns: ClassVar[tuple[Unknown, ...]] = POINT
    columns: ClassVar[tuple[Column, ...]] = ()

    @property
    def parts(self) -> Mapping[str, slice]:
        """It stands at one of its sites each time: which of them moved, the pose says."""
        return {f"socket:{name}": slice(0, 3) for name in self.names}

    @property
    def metric(self) -> bool:
        return False

    def read(self, place: Array, points: Array) -> Array:
        moved = place.reshape((*place.shape[:-1], -1, 3)).sum(axis=-2)  # from where it stood
        return np.asarray(points - moved[..., None, None, :])

    def linearise(self, place: Array, points: Array) -> Linear:
        rows = self.read(place, points)
        by_place = np.tile(-np.eye(3), (1, place.shape[-1] // 3))
        return Linear(rows, None, np.broadcast_to(by_place, (*rows.shape, place.shape[-1])))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """``R_i u - c = -p_i`` is linear in the markers and c; one that is known leaves their mean."""
        del rows
        pose, channel, points = contacts(seen, arm)
        told = arm.free & np.any(seen, axis=0)[:, None]
        free = np.argwhere(told)
        own = np.asarray(np.equal(channel[:, None], free[:, 0]))
        lever = np.where(own[:, None, :], arm.R_tip[pose][:, :, free[:, 1]], 0.0)
        # Without their means rows speak of the markers alone.
        A = (lever - lever.mean(axis=0)).reshape(3 * len(pose), len(free))
        off = np.asarray((points - points.mean(axis=0)).reshape(-1))
        offsets, _, rank, _ = np.linalg.lstsq(A, -off, rcond=_SINGULAR)
        markers = arm.markers.copy()
        markers[told] += offsets
        place = points.mean(axis=0) + lever.mean(axis=0) @ offsets
        return Start(place, markers, told if rank == len(free) else np.zeros_like(told))


_SINGULAR = 0.05  # of the largest lever: below, a nominal arm's error would look like a marker's
