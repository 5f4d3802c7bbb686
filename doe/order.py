"""A day of measurement: the poses in a short order, those that are visited again, and the time.

Second visits of a pose alone tell how well the arm comes back: each brings a degree of freedom for
each coordinate of the tip that the markers show, six of three markers, three of one. They are spread
over the day, so that its drift is no part of one time alone, and come from the other side: what differs
between two sides is no scatter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.errors import CalibError
from calib.poses import Poses
from doe.constraints import scene_of, visible
from doe.problem import Problem

_FULL_SPEED_IN = 0.5  # s, from rest, where no acceleration is given
_STARTS = 12  # places from which a way is begun
_LEAST = 1e-9  # of the mean cost: an improvement
_SEEN = 1e-6  # of the largest sensitivity: a direction that moves the markers less is not read
_DETOUR = 0.25  # what the time of a mean way weighs beside all joints from the other side


def day_of(cell: Cell, poses: Poses) -> float:
    """Seconds of a day, from the first pose on; NaN where not all speeds are known.

    The arm is on its way, settles and is read, and the load is hung and taken off.
    """
    if cell.robot.speeds is None or np.isnan(cell.robot.speeds).any():
        return float("nan")
    standing = len(poses) * cell.pace.standing(cell.load is not None)
    return standing + float(durations(cell, np.diff(poses.q, axis=0)).sum())


def durations(cell: Cell, steps: Array) -> Array:
    """Seconds that straight motions (.., dof), rad or m, take from rest to rest, shape (..).

    All joints begin and end together: the slowest one is accelerated, driven at its speed and braked.
    Where not all speeds are known the joints count as equally fast, one a second: it only compares.
    """
    robot, share = cell.robot, cell.pace.speed
    speeds = np.full(robot.dof, np.nan) if robot.speeds is None else robot.speeds
    speeds = np.ones(robot.dof) if np.isnan(speeds).any() else speeds
    given = np.full(robot.dof, np.nan) if robot.accelerations is None else robot.accelerations
    v, a = share * speeds, share * np.where(np.isnan(given), speeds / _FULL_SPEED_IN, given)
    far = np.abs(steps)
    each = np.where(far * a >= v**2, far / v + v / a, 2.0 * np.sqrt(far / a))
    return np.asarray(each.max(axis=-1))


def travel(q: Array) -> float:
    """Joint travel of a sequence q, shape (m, n), of joints of one unit: of each move the farthest."""
    return float(np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0).sum())


def quickest_order(cell: Cell, q: Array) -> IntArray:
    """The order of poses (m, dof) with little time between them; it ends anywhere."""
    return shortest_order(durations(cell, q - q[:, None]))


def shortest_order(cost: Array) -> IntArray:
    """Order of n places with a small sum of costs (n, n) from each to the next; it ends anywhere.

    From some of the places to the nearest one that is left, and so on; then stretches are reversed
    while that helps (Croes, Operations Research 6(6), 1958). The shortest of these ways is taken.
    """
    n = len(cost)
    if n < 3:
        return np.arange(n)
    starts = np.unique(np.linspace(0, n - 1, _STARTS).astype(int))
    ways = [_improved(_nearest(int(start), cost), cost) for start in starts]
    way = min(ways, key=lambda way: float(cost[way[:-1], way[1:]].sum()))
    # Of a way and its reverse, which are equally long, the one that begins with the earlier place.
    return np.asarray(way if way[0] < way[-1] else way[::-1])


def _nearest(start: int, cost: Array) -> IntArray:
    way, left = [start], np.ones(len(cost), dtype=bool)
    left[start] = False
    while left.any():
        way.append(int(np.where(left, cost[way[-1]], np.inf).argmin()))
        left[way[-1]] = False
    return np.array(way)


def _improved(way: IntArray, cost: Array) -> IntArray:
    """The way after the best reversals, one after another, until none helps."""
    least = -_LEAST * float(cost.mean())
    while True:
        # Ends join nothing: a place of no cost stands before the first one and after the last.
        step = cost[way[:-1], way[1:]]
        before, after = np.append(0.0, step), np.append(step, 0.0)
        joined = np.zeros((len(way), len(way)))
        joined[1:] += cost[way[:-1, None], way]  # the one before i is followed by j
        joined[:, :-1] += cost[way[:, None], way[1:]]  # and i by the one after j
        gain = joined - before[:, None] - after
        gain[np.tril_indices(len(way))] = 0.0
        i, j = np.unravel_index(int(gain.argmin()), gain.shape)
        if gain[i, j] >= least:
            return way
        way = np.concatenate([way[:i], way[i : j + 1][::-1], way[j + 1 :]])


@dataclass(frozen=True)
class Reapproaches:
    """Poses of the plan that are visited a second time.

    poses : tuple of str, the plan's; again : tuple of str, each one's second visit
    dof : int, coordinates that tell of the repeatability, if it is well above the instrument's noise
    """

    poses: tuple[str, ...]
    again: tuple[str, ...]
    dof: int

    @property
    def error(self) -> float:
        """Relative standard deviation of the repeatability of translation, and of rotation."""
        return float(1.0 / np.sqrt(self.dof))


def with_reapproaches(problem: Problem, poses: Poses, count: int) -> tuple[Poses, Reapproaches]:
    """The poses, some of them once more, over the whole day and from the other side.

    The later one of two visits is named ``_again``. The last pose is never among them.

    Raises CalibError where the plan has too few poses.
    """
    chosen = _spread(problem.cell, poses, count)
    day = over_the_day(problem.cell, poses.q, chosen)
    later = [i in day[:k] for k, i in enumerate(day)]
    names = [f"{poses.names[i]}{'_again' * second}" for i, second in zip(day, later, strict=True)]
    visited = replace(poses.take(np.array(day)), names=tuple(names), time=None, order=None)
    once = tuple(poses.names[i] for i in chosen)
    q = poses.q[chosen]
    H = problem.regressor.sensitivities(q, visible(scene_of(problem.cell, q)))
    shown = np.linalg.svd(H, compute_uv=False)
    dof = int((shown > _SEEN * shown.max()).sum())
    return visited, Reapproaches(once, tuple(f"{name}_again" for name in once), dof)


def _spread(cell: Cell, poses: Poses, count: int) -> list[int]:
    """Of the poses those farthest from each other, in their order.

    Arms return worse in some postures than in others: the figure is to hold for the workspace.
    """
    first = np.unique(poses.configuration, return_index=True)[1]
    may = np.sort(first[poses.configuration[first] != poses.configuration[-1]])
    if not 0 < count <= len(may):
        raise CalibError(
            f"{count} poses cannot be visited again: {len(may)} of {len(poses)} can, as the arm stands "
            "at the last one; ask for fewer, or for more poses"
        )
    low, high = cell.robot.sample_limits().T
    at = poses.q[may] / np.maximum(high - low, 1e-9)
    apart = np.abs(at[:, None] - at).max(axis=-1)
    chosen = [int(apart.mean(axis=1).argmax())]
    while len(chosen) < count:
        chosen.append(int(apart[:, chosen].min(axis=1).argmax()))
    return list(map(int, may[sorted(chosen)]))


def over_the_day(cell: Cell, q: Array, chosen: list[int]) -> list[int]:
    """The order of poses (m, dof) with second visits of those chosen, in parts of the day alike.

    Each part, the last one first, takes that of them which comes from the other side with most joints
    and at little detour; two visits of a pose have another one between them.
    """
    day, left, ways = list(range(len(q))), list(chosen), durations(cell, q - q[:, None])
    ends = np.linspace(1, len(q) + 1, len(chosen) + 1).round().astype(int).tolist()
    for first, end in reversed(list(pairwise(ends))):
        # A part may be as short as the way round its poses.
        offers = _offers(q, ways, day, left, range(first, end)) or _offers(
            q, ways, day, left, range(1, len(day) + 1)
        )
        _, at, pose = min(offers)
        day.insert(at, pose)
        left.remove(pose)
    return day


def _offers(
    q: Array, ways: Array, day: list[int], left: list[int], places: range
) -> list[tuple[float, int, int]]:
    """Cost, place and pose of every second visit that may stand there."""
    mean, offers = float(ways.mean()) or 1.0, []
    for at, pose in product(places, left):
        before, after = day[at - 1], day[at] if at < len(day) else None
        if pose in (before, after):
            continue
        k = day.index(pose)
        side = np.sign(q[pose] - q[day[k - 1]]) if k else np.zeros(q.shape[1])
        other = float((side * np.sign(q[pose] - q[before]) < 0.0).mean())
        detour = ways[before, pose]
        if after is not None:
            detour += ways[pose, after] - ways[before, after]
        offers.append((_DETOUR * float(detour) / mean - other, at, pose))
    return offers
