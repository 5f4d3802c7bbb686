"""Where the arm meets what it touches.

A contact is a marker at a plane or a socket whose place the cell gives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.instruments import Instrument
from calib.poses import Poses

TOUCHES = 1e-5  # m: a pose of a plan that misses by more touches nothing


@dataclass(frozen=True, eq=False)
class Contact:
    """A marker at one of the places of an instrument.

    site : str, its name; place : ndarray, shape (u,); channel, marker : int, positions in the cell
    """

    instrument: Instrument
    site: str
    place: Array
    channel: int
    marker: int

    def missed(self, points: Array) -> Array:
        """Rows (m, r), m, that are zero where markers (m, 3) touch."""
        return self.instrument.read(self.place, points[:, None])[:, 0]


def contacts_of(cell: Cell) -> tuple[Contact, ...]:
    """All that the arm can touch, site by site; none where nobody says where they stand."""
    found = []
    for instrument, part in cell.channels.blocks:
        if not instrument.touches or instrument.unforeseen:
            continue
        for site in instrument.names:
            place = instrument.guess_at(site)
            for channel in range(part.start, part.stop):
                marker = int(cell.channels.marker[channel])
                found.append(Contact(instrument, site, place, channel, marker))
    return tuple(found)


def touched(cell: Cell, q: Array) -> IntArray:
    """Which of the contacts each configuration (m, dof) makes, by position, (m,); -1 for none."""
    contacts = contacts_of(cell)
    if not contacts:
        return np.full(len(q), -1)
    frames, missed = forward(cell.robot, q), []
    for own in contacts:
        tip, marker = cell.marker_frames[own.marker], cell.markers[own.marker]
        points = rotate(frames.R[:, tip], marker) + frames.o[:, tip]
        missed.append(np.linalg.norm(own.missed(points), axis=1))
    return np.where(np.min(missed, axis=0) <= TOUCHES, np.argmin(missed, axis=0), -1)


def with_sites(cell: Cell, poses: Poses) -> Poses:
    """Poses that say which site they touch; as they are where they say so, or none has sites."""
    if poses.site is not None or not any(i.sites for i in cell.instruments):
        return poses
    names = np.array([*(contact.site for contact in contacts_of(cell)), ""])
    return replace(poses, site=names[touched(cell, poses.q)])
