"""Poses of a plan that are visited again: they alone tell how well the arm comes back.

Two visits of one pose differ by what both approaches were off by, and by the instrument: with H the
levers of the tip on the whitened readings, times the repeatability of each of its coordinates, the
differences have the covariance ``2 (I + H H^T)``. So with ``K = H^T H (I + H^T H)^-1`` a second visit
brings the Fisher information ``2 |K_ab|^2`` on the logarithms of the repeatabilities a and b, of
translation and rotation, and ``2 |K|^2`` on a factor that is common to both: two for each coordinate
that is read well beyond the instrument's noise, of which three markers show six and one shows three.

The visits are spread over the day, so that its drift is no part of one time alone, and come from the
other side: what differs between two sides is no scatter.
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
from doe.order import durations
from doe.problem import Problem

_SEEN = 1e-6  # of the largest lever: a direction that moves the markers less is not read
_NO_DIFFERENCE = 0.5  # coordinates
_DETOUR = 0.25  # what the time of a mean way weighs beside all joints from the other side


@dataclass(frozen=True)
class Reapproaches:
    """Poses of the plan that are visited a second time.

    poses : tuple of str, the plan's own; again : tuple of str, each one's second visit
    dof : float, coordinates that tell of the repeatability, each for as much as the instrument lets it
    translation, rotation : float, relative standard deviations with which each is known beside the
        other, NaN where the markers do not tell them apart, or one is none
    asked : bool, else they are among the poses that were asked for
    """

    poses: tuple[str, ...]
    again: tuple[str, ...]
    dof: float
    translation: float
    rotation: float
    asked: bool

    @property
    def common(self) -> float:
        """Relative standard deviation of the repeatability if the ratio of both is known."""
        return float(1.0 / np.sqrt(2.0 * self.dof))


def with_reapproaches(problem: Problem, poses: Poses, count: int) -> tuple[Poses, Reapproaches]:
    """The poses, some of them once more, over the whole day and from the other side.

    The later one of two visits is named ``_again``. The last pose is never among them.

    Raises CalibError where the plan has too few poses.
    """
    chosen = _spread(problem, poses, count)
    day = over_the_day(problem.cell, poses.q, chosen.tolist())
    later = [i in day[:k] for k, i in enumerate(day)]
    own = [poses.names[i] for i in day]
    names = [f"{n}_again" if second else n for n, second in zip(own, later, strict=True)]
    visited = replace(poses.take(np.array(day)), names=tuple(names), time=None, order=None)
    K = shares(problem, poses.q[chosen])
    alone = _alone(K) if (np.linalg.matrix_rank(K, tol=_SEEN) == 6).any() else (np.nan, np.nan)
    again = tuple(poses.names[i] for i in chosen)
    dof, asked = float((K**2).sum()), problem.request.asked
    return visited, Reapproaches(again, tuple(f"{n}_again" for n in again), dof, *alone, asked)


def over_the_day(cell: Cell, q: Array, chosen: list[int]) -> list[int]:
    """The order of poses (m, dof) with second visits of those chosen, in parts of the day alike.

    Each part, the last one first, takes that of them which comes from the other side with most joints
    and at little detour; two visits of a pose have another one between them.
    """
    day, left, ways = list(range(len(q))), list(chosen), durations(cell, q - q[:, None])
    ends = np.linspace(1, len(q) + 1, len(chosen) + 1).round().astype(int).tolist()
    for first, end in reversed(list(pairwise(ends))):
        offers = _offers(q, ways, day, left, range(first, end))
        if not offers:  # a part as short as the way round its poses
            offers = _offers(q, ways, day, left, range(1, len(day) + 1))
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


def shares(problem: Problem, q: Array) -> Array:
    """What a visit of each configuration (m, dof) tells of the tip's coordinates, K, shape (m, 6, 6).

    Where the repeatability is not known it is taken for much larger than the instrument's noise.
    """
    H = problem.regressor.levers(q, visible(scene_of(problem.cell, q)))
    arm = problem.cell.repeatability
    if arm is None or not problem.cell.scatters:
        sizes = np.sqrt((H**2).mean(axis=(0, 1)).reshape(2, 3).mean(axis=1))
        H = H / np.repeat(np.where(sizes > 0.0, sizes, 1.0), 3)
        return np.asarray(np.linalg.pinv(H, rcond=_SEEN) @ H)
    H = H * np.repeat([arm.translation, arm.rotation], 3)
    G = np.swapaxes(H, -1, -2) @ H
    return np.asarray(np.linalg.solve(np.eye(6) + G, G))


def _alone(K: Array) -> tuple[float, float]:
    """Relative standard deviations of translation and rotation; NaN for one that is none."""
    information = 2.0 * (K.reshape(-1, 2, 3, 2, 3) ** 2).sum(axis=(0, 2, 4))
    std, some = np.full(2, np.nan), np.diag(information) > 0.0
    std[some] = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(some, some)])))
    return float(std[0]), float(std[1])


def _spread(problem: Problem, poses: Poses, count: int) -> IntArray:
    """Of the poses that tell most of the repeatability, those farthest from each other, (count,).

    Arms return worse in some postures than in others: the figure is to hold for the workspace.
    """
    first = np.unique(poses.configuration, return_index=True)[1]
    may = np.sort(first[poses.configuration[first] != poses.configuration[-1]])
    if count > len(may):
        raise CalibError(
            f"{count} poses cannot be visited again: {len(may)} of {len(poses)} can, as the arm stands "
            "at the last one; ask for fewer, or for more poses"
        )
    shown = (shares(problem, poses.q[may]) ** 2).sum(axis=(1, 2))
    low, high = problem.cell.robot.sample_limits().T
    at = poses.q[may] / np.maximum(high - low, 1e-9)
    apart = np.abs(at[:, None] - at).max(axis=-1)
    chosen: list[int] = []
    for _ in range(count):
        free = np.setdiff1d(np.arange(len(may)), chosen)
        free = free[shown[free] >= shown[free].max() - _NO_DIFFERENCE]
        away = apart[np.ix_(free, chosen)].min(axis=1) if chosen else apart[free].mean(axis=1)
        chosen.append(int(free[away.argmax()]))
    return np.asarray(may[np.sort(chosen)])
