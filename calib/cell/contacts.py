"""Where the arm meets what it touches: poses that are solved for, as none that is drawn lies there.

A contact is a marker at a plane, a sphere or a socket whose place the cell gives. Joint values are
brought to it by Newton's steps of least length, within the limits, so that even starts stay spread over
all configurations that touch. The arm is the nominal one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import Frames, forward, point_slopes
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.instruments import Instrument
from calib.poses import Poses

TOUCHES = 1e-5  # m: a pose of a plan that misses by more touches nothing
_THERE, _MET = 1e-10, 1e-9  # m
_STEPS, _BY_NOW = 30, 8
_NEAR = 0.05  # of the reach: a start that is farther by now will not come
_LONGEST = 0.5  # rad, or of the reach, in one step
# Of the largest lever, and beside it: damping near singular poses.
_RELUCTANT, _NOTHING = 1e-8, 1e-12


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
    frames = forward(cell.robot, q)
    rows = [contact.missed(_points(cell, contact, frames)) for contact in contacts]
    missed = np.stack([np.linalg.norm(row, axis=1) for row in rows], axis=1)
    return np.where(missed.min(axis=1) <= TOUCHES, missed.argmin(axis=1), -1)


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
    for k, contact in enumerate(contacts_of(cell)):
        own = np.flatnonzero(wanted == k)
        if len(own):
            may_move = np.ones(q.shape[1], bool) if free is None else free
            met, there = _met(cell, contact, q[own], may_move)
            q[own[there]] = met[there]
    return q


def _met(cell: Cell, contact: Contact, q: Array, free: Mask) -> tuple[Array, Mask]:
    """Where Newton's steps end, and whether that is at the contact."""
    robot = cell.robot
    low, high = robot.sample_limits().T
    units = np.where(robot.prismatic, robot.reach, 1.0)
    now = np.arange(len(q))
    for count in range(_STEPS):
        frames = forward(robot, q[now])
        points = _points(cell, contact, frames)
        slopes = point_slopes(robot, frames, points)
        off = contact.missed(points)
        size = np.linalg.norm(off, axis=1)
        coming = (size < _NEAR * robot.reach) | (count < _BY_NOW)
        left = (size > _THERE) & coming
        now, off, points = now[left], off[left], points[left]
        if not len(now):
            break
        levers = slopes[left] @ robot.ties.matrix
        J = contact.slopes(points) @ levers * (units * free)
        step = _least(J, -off) * units
        # A joint at its limit that is pushed beyond it stays, and the others go the way.
        stuck = ((q[now] <= low) & (step < 0.0)) | ((q[now] >= high) & (step > 0.0))
        step = _least(J * ~stuck[:, None, :], -off) * units
        size = np.linalg.norm(step / units, axis=1, keepdims=True)
        step *= np.minimum(1.0, _LONGEST / np.maximum(size, 1e-300))
        q[now] = robot.tied(np.clip(q[now] + step, low, high))
    points = _points(cell, contact, forward(robot, q))
    return q, np.linalg.norm(contact.missed(points), axis=1) < _MET


def _least(J: Array, wanted: Array) -> Array:
    """The least steps (m, n) with ``J step = wanted``, (m, r)."""
    Jt = np.swapaxes(J, -1, -2)
    A = J @ Jt
    size = np.trace(A, axis1=-2, axis2=-1)[:, None, None] + _NOTHING
    solved = np.linalg.solve(A + _RELUCTANT * size * np.eye(A.shape[-1]), wanted[..., None])
    return np.asarray((Jt @ solved)[..., 0])


def _points(cell: Cell, contact: Contact, frames: Frames) -> Array:
    return rotate(frames.R[:, -1], cell.markers[contact.marker]) + frames.o[:, -1]
