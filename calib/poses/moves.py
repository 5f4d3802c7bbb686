"""From which side, and how far, each joint came: what the order of measurement says.

The order is that of time where the poses have it, else that of their numbers, else of the file. Where
the arm went from one session to the next, or while no reading was taken for an hour, nobody knows:
moves begin anew there. Readings between which the arm was nowhere else are one visit. What is fitted is
ordered by itself; held-out poses follow, where there is a clock, on what came before them in either
table.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray, Mask, TextArray
from calib.poses import LAGS, Measurements, Poses, poses_at

_MOVED = 1e-5  # rad or m: less is the trembling of a servo, and turns no gear round
_LONGEST = 3600.0  # s without a reading, in which the arm may have gone anywhere


def moves(q: Array, begins: Mask | None = None) -> tuple[Array, Array]:
    """Approach and size of move at joint values in the order in which they were reached.

    q : ndarray, shape (m, n), rad or m
    begins : ndarray of bool, shape (m,), where nothing is known of the way from the reading before; by
        default at the first alone
    Returns the sign of the last motion of each joint, and how far each went in the move that led to
    the configuration, both (m, n). A reading that follows without a move keeps those of the reading
    before; where a way begins nothing is known, and both are zero.
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    step[np.abs(step) < _MOVED] = 0.0
    fresh = np.zeros((len(q), 1), dtype=bool) if begins is None else begins[:, None]
    step[fresh[:, 0]] = 0.0
    row = np.arange(len(q))[:, None]
    last = np.maximum.accumulate(np.where((step != 0.0) | fresh, row, 0), axis=0)
    arrived = step.any(axis=1, keepdims=True) | fresh
    arrival = np.maximum.accumulate(np.where(arrived, row, 0), axis=0)
    return np.take_along_axis(np.sign(step), last, axis=0), np.abs(step)[arrival[:, 0]]


def with_moves(poses: Poses) -> Poses:
    """The poses of one table with order, approach, size of move, late temperature, and its start.

    An approach that the table gave is kept.
    """
    order, back = in_order(poses), np.empty(len(poses), dtype=int)
    back[order] = np.arange(len(poses))
    fresh = begins(poses)[order]
    approach, motion = (own[back] for own in moves(poses.q[order], fresh))
    lagged = None
    if poses.temperature is not None and poses.time is not None:
        lagged = followed(poses.temperature[order], poses.time[order], fresh)[back]
    derived = poses.approach is None or poses.approach_derived
    return replace(
        poses,
        start=0.0 if poses.time is None else float(poses.time.min(initial=np.inf)),
        order=back.astype(float),
        approach=approach if derived else poses.approach,
        approach_derived=derived,
        motion=motion,
        lagged=lagged,
    )


def followed(temperature: Array, time: Array, fresh: Mask) -> Array:
    """What follows a temperature (m,), degC, with each time constant of ``LAGS``, shape (m, L).

    It is in balance where a session begins: fresh, shape (m,), in the order of time (m,), s.
    """
    late = np.repeat(temperature[:, None], len(LAGS), axis=1)
    kept = np.exp(-np.diff(time, prepend=time[:1])[:, None] / LAGS)
    for i in np.flatnonzero(~fresh):
        late[i] += kept[i] * (late[i - 1] - late[i])
    return late


def in_order(poses: Poses) -> IntArray:
    """Positions of the poses in the order of measurement.

    Readings of one session belong together, and a clock may begin anew with each.
    """
    clock = poses.time if poses.time is not None else poses.order
    if clock is None:
        clock = np.arange(float(len(poses)))
    if poses.session is None:
        return np.argsort(clock, kind="stable")
    _, first, number = np.unique(poses.session, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    earliest = np.full(len(first), np.inf)
    np.minimum.at(earliest, number, clock)
    return np.lexsort((clock, first[number], earliest[number]))


def begins(poses: Poses) -> Mask:
    """Readings before which nobody knows where the arm was, shape (m,).

    The first of all, of a session, and after more than an hour without a reading.
    """
    order = in_order(poses)
    fresh = np.arange(len(poses)) == 0
    if poses.time is not None:
        fresh[1:] |= np.diff(poses.time[order]) > _LONGEST
    if poses.session is not None:
        fresh[1:] |= poses.session[order][1:] != poses.session[order][:-1]
    unknown = np.empty(len(poses), dtype=bool)
    unknown[order] = fresh
    return unknown


def before_the_first_move(poses: Poses) -> Mask:
    """Readings whose approach should follow from the order and does not, shape (m,).

    They come first of all, or after what no move reaches across. None where no joint ever moves: what
    asks for moves cannot act there.
    """
    if poses.approach is None or not poses.approach_derived or not poses.approach.any():
        return np.zeros(len(poses), dtype=bool)
    return np.asarray(np.logical_not(poses.approach.any(axis=1)))


# -- two tables ----------------------------------------------------------------------------------


def in_one_session(data: Measurements, heldout: Measurements) -> tuple[Measurements, Measurements]:
    """Two tables of one robot: what is fitted as it is, what is held out as it follows on both.

    What is fitted must not depend on what is held out. A held-out pose has the moves that lead to it
    from the reading before, of either table, and its time counts from the start of what is fitted.
    Without a time in both nothing says how they interleave: held-out poses keep their own moves, and
    when they were read is unknown, unless both are parts of one table.
    """
    first, second = data.poses, heldout.poses
    if parts_of_one_table(first, second):
        return data, heldout
    if first.time is None or second.time is None:
        return data, replace(heldout, poses=replace(second, time=None, order=None))
    q, time = np.concatenate([first.q, second.q]), np.concatenate([first.time, second.time])
    heat = None
    if first.temperature is not None and second.temperature is not None:
        heat = np.concatenate([first.temperature, second.temperature])
    both = with_moves(poses_at(q, time=time, temperature=heat, session=_sessions(first, second)))
    own = both.take(slice(len(first), None))
    poses = replace(
        second,
        start=first.start,
        order=None,  # it is a number among the fitted readings
        approach=own.approach if second.approach_derived else second.approach,
        motion=own.motion,
        lagged=own.lagged,
    )
    return data, replace(heldout, poses=poses)


def _sessions(first: Poses, second: Poses) -> TextArray | None:
    """The session of each pose of two tables; one table's without a name is none of the other's."""
    if first.session is None and second.session is None:
        return None
    each = (np.full(len(p), "") if p.session is None else p.session for p in (first, second))
    return np.concatenate(list(each))


def parts_of_one_table(first: Poses, second: Poses) -> bool:
    """Whether two sets of poses were read one after the other as their order says."""
    if first.order is None or second.order is None:
        return False
    return not np.isin(second.order, first.order).any()


def of_one_clock(first: Poses, second: Poses) -> bool:
    """Whether the clock of one session shows when both were read."""
    timed = first.time is not None and second.time is not None
    return timed or parts_of_one_table(first, second)


# -- stays, and a part of many readings ----------------------------------------------------------


def visits(poses: Poses) -> IntArray:
    """Number of the stay to which each reading belongs, shape (m,), in the order of measurement.

    A stay lasts until the arm goes to other joints, or the instrument to another station, or nobody
    knows whether it did. Where poses in between were left out, the size of the last move still shows
    that the arm was elsewhere.
    """
    order = in_order(poses)
    moved = [] if poses.motion is None else list(poses.motion.T)
    where = np.column_stack([poses.configuration, poses.station, *moved])[order]
    left = np.diff(where, axis=0, prepend=where[:1]).any(axis=1) | begins(poses)[order]
    number = np.empty(len(poses), dtype=int)
    number[order] = np.cumsum(left)
    return number


def alike(poses: Poses) -> IntArray:
    """Number of the state of each reading, shape (m,): equal joints, loads and station.

    Unlike ``Poses.repeated`` it does not ask from which side the joints came.
    """
    return poses.grouped([])


def thinned(data: Measurements, most: int) -> tuple[Measurements, tuple[str, ...]]:
    """At most so many readings of a table, and a sentence that says so; all, and none, if they are few.

    They lie as :func:`spread` says.
    """
    kept = spread(data, most)
    return (data, ()) if kept.all() else (data.take(kept), (thinned_words(data, kept),))


def thinned_words(data: Measurements, kept: Mask) -> str:
    """How many readings of a table were used, and where they lie."""
    alone = len(np.unique(visits(data.poses)[kept])) == kept.sum()
    among = "spread evenly over all" if alone else "the same number at each stop of the arm"
    return f"{kept.sum()} of {len(data)} readings were used, {among}"


def spread(data: Measurements, most: int) -> Mask:
    """Which readings of a table are used where there are at most so many, shape (m,).

    Readings of one stay repeat each other but for the instrument's noise: every stay keeps as many as
    all others, evenly over its time, or all that it has. Where there are more stays than that, an even
    choice of them keeps one reading each.
    """
    if len(data) <= most:
        return np.ones(len(data), dtype=bool)
    stay = visits(data.poses) - 1
    counts = np.bincount(stay)
    # The largest number of readings of a stay, one at least, of which all have at most so many.
    sizes = np.arange(1, int(counts.max()) + 1)
    kept_of = np.minimum(counts, sizes[:, None]).sum(axis=1) if len(counts) <= most else [most + 1]
    each = max(1, int((np.asarray(kept_of) <= most).sum()))
    order = np.argsort(stay, kind="stable")
    place = np.empty(len(data), dtype=int)  # of each reading in its stay
    place[order] = np.arange(len(data)) - np.repeat(np.cumsum(counts) - counts, counts)
    kept = _even(place, counts[stay], each)
    if len(counts) > most:
        kept &= _even(stay, np.array(len(counts)), most)
    return kept


def _even(place: IntArray, count: IntArray, most: int) -> Mask:
    """Whether each place among ``count`` is one of at most so many that lie evenly."""
    part = place * np.minimum(count, most) // count
    before = (place - 1) * np.minimum(count, most) // count
    return np.asarray(part != before)
