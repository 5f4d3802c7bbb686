"""From which side, and how far, each joint came: what the order of measurement tells.

The order is that of time where the poses have it, else that of the file. A table of held-out poses is
part of the same session, so both are ordered together before anything is fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.poses import Measurements, Poses, poses_at

_MOVED = 1e-5  # rad or m: less is the trembling of a servo, and turns no gear round


def moves(q: Array) -> tuple[Array, Array]:
    """Approach and size of move at joint values in the order in which they were reached.

    q : ndarray, shape (m, n), rad or m
    Returns the sign of the last motion of each joint, and how far each went in the move that led to
    the configuration, both (m, n). A reading that follows without a move keeps those of the reading
    before; at the first configuration nothing is known, and both are zero.
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    step[np.abs(step) < _MOVED] = 0.0
    row = np.arange(len(q))[:, None]
    last = np.maximum.accumulate(np.where(step != 0.0, row, 0), axis=0)
    arrival = np.maximum.accumulate(np.where(step.any(axis=1, keepdims=True), row, 0), axis=0)
    return np.take_along_axis(np.sign(step), last, axis=0), np.abs(step)[arrival[:, 0]]


def with_moves(poses: Poses) -> Poses:
    """The poses of one session with their order, approach, size of move, and when it began.

    An approach that the poses already have is kept.
    """
    order = in_order(poses)
    approach, motion = np.empty_like(poses.q), np.empty_like(poses.q)
    approach[order], motion[order] = moves(poses.q[order])
    number = np.empty(len(poses))
    number[order] = np.arange(len(poses))
    derived = poses.approach is None or poses.approach_derived
    return replace(
        poses,
        start=0.0 if poses.time is None else float(poses.time.min(initial=np.inf)),
        order=number,
        approach=approach if derived else poses.approach,
        approach_derived=derived,
        motion=motion,
    )


def before_the_first_move(poses: Poses) -> Mask:
    """Readings whose approach should follow from the order and does not, shape (m,).

    None where no joint ever moves: nothing comes first there, and what asks for moves cannot act.
    """
    if poses.approach is None or not poses.approach_derived or not poses.approach.any():
        return np.zeros(len(poses), dtype=bool)
    return np.asarray(np.logical_not(poses.approach.any(axis=1)))


def in_one_session(data: Measurements, heldout: Measurements) -> tuple[Measurements, Measurements]:
    """Two tables of one session, with moves and time counted over both.

    Without a time in both nothing says how they interleave: each keeps its own moves, and when in the
    session the held-out poses were read is unknown, unless both are parts of one table.
    """
    first, second = data.poses, heldout.poses
    if first.time is None or second.time is None:
        if parts_of_one_table(first, second):
            return data, heldout
        return data, replace(heldout, poses=replace(second, time=None, order=None))
    q, time = np.concatenate([first.q, second.q]), np.concatenate([first.time, second.time])
    session = with_moves(poses_at(q, time=time))
    ours, theirs = session.take(slice(len(first))), session.take(slice(len(first), None))
    return _within(data, ours), _within(heldout, theirs)


def parts_of_one_table(first: Poses, second: Poses) -> bool:
    """Whether two sets of poses, without time, were read one after the other as their order says."""
    if first.time is not None or second.time is not None:
        return False
    if first.order is None or second.order is None:
        return False
    return not np.isin(second.order, first.order).any()


def of_one_clock(first: Poses, second: Poses) -> bool:
    """Whether the clock of one session shows when both were read."""
    timed = first.time is not None and second.time is not None
    return timed or parts_of_one_table(first, second)


def _within(own: Measurements, session: Poses) -> Measurements:
    """A table with what the whole session tells of its poses."""
    poses = own.poses
    approach = session.approach if poses.approach_derived else poses.approach
    poses = replace(
        poses,
        start=session.start,
        order=session.order,
        approach=approach,
        motion=session.motion,
    )
    return replace(own, poses=poses)


def in_order(poses: Poses) -> IntArray:
    """Positions of the poses in the order of measurement."""
    if poses.time is None:
        return np.arange(len(poses))
    return np.argsort(poses.time, kind="stable")
