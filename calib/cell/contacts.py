"""Where the arm meets what it touches: poses that are solved for, as none that is drawn lies there.

A contact is a marker at a plane or a socket whose place the cell gives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.arm.approach import approached
from calib.arm.kinematics import Frames, forward, point_slopes
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.instruments import Instrument
from calib.poses import Poses

TOUCHES = 1e-5  # m: a pose of a plan that misses by more touches nothing
_MET = 1e-9  # m


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

    def slopes(self, points: Array) -> Array:
        """Their derivatives by the markers, (m, r, 3)."""
        by = self.instrument.linearise(self.place, points[:, None]).by_points
        each = np.eye(3) if by is None else by[:, 0]
        return np.broadcast_to(each, (len(points), *each.shape[-2:]))


def contacts_of(cell: Cell) -> tuple[Contact, ...]:
    """All that the arm can be brought to, site by site; none where nobody says where they stand."""
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
    missed = np.stack([_distance(cell, contact, q) for contact in contacts], axis=1)
    return np.where(missed.min(axis=1) <= TOUCHES, missed.argmin(axis=1), -1)


def _distance(cell: Cell, contact: Contact, q: Array) -> Array:
    points = _points(cell, contact, forward(cell.robot, q))
    return np.asarray(np.linalg.norm(contact.missed(points), axis=1))


def with_sites(cell: Cell, poses: Poses) -> Poses:
    """Poses that say which site they touch; as they are where they say so, or none has sites."""
    if poses.site is not None or not any(i.sites for i in cell.instruments):
        return poses
    names = np.array([*(contact.site for contact in contacts_of(cell)), ""])
    return replace(poses, site=names[touched(cell, poses.q)])


def brought(cell: Cell, q: Array, wanted: IntArray, free: Mask | None = None) -> Array:
    """Configurations (m, dof) brought to the contacts wanted of each, (m,), where that is in reach.

    wanted : positions among the contacts, -1 for none
    free : ndarray of bool, shape (dof,), joints that may move, all without it
    """
    q = q.copy()
    free = np.ones(q.shape[1], bool) if free is None else free
    for k, contact in enumerate(contacts_of(cell)):
        own = np.flatnonzero(wanted == k)
        if len(own):
            met = approached(cell.robot, q[own], free, partial(_missed, cell, contact))
            there = _distance(cell, contact, met) < _MET
            q[own[there]] = met[there]
    return q


def _missed(cell: Cell, contact: Contact, starts: IntArray, frames: Frames) -> tuple[Array, Array]:
    del starts
    points = _points(cell, contact, frames)
    frame = cell.marker_frames[contact.marker]
    slopes = point_slopes(cell.robot, frames, points, frame)
    return contact.missed(points), contact.slopes(points) @ slopes


def _points(cell: Cell, contact: Contact, frames: Frames) -> Array:
    frame = cell.marker_frames[contact.marker]
    return rotate(frames.R[:, frame], cell.markers[contact.marker]) + frames.o[:, frame]
