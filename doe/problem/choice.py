"""What a plan chooses beside joint angles: the last move to each pose, and when it is read.

Lost motion, friction and settling depend on the last move of a joint; drift and heat on the time. What
of these a cell's model needs to know is chosen like the joint angles: a short move that ends at the
pose, and one of the moments of the day.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.effects import catalogue
from calib.errors import CalibError
from calib.model.build import parse_effect
from calib.poses import Poses
from doe.day.approach import LAST_MOVES
from doe.day.duration import durations, paced
from doe.problem.request import PLANNED, Request
from doe.problem.visits import Visits, joined

_MOST_MOMENTS = 40
_NOTHING = frozenset[str]()
_OF_MOVES = frozenset({"approach", "motion"})


@dataclass(frozen=True, eq=False)
class Choice:
    """What a cell's model needs to know of a visit beside the joints.

    sided : ndarray of bool, shape (dof,), joints whose last move counts
    sizes : ndarray, shape (k, dof), rad or m, of the last moves, of which a plan may choose
    times : ndarray, shape (k,), s, moments of the day, as many as poses or fewer; empty where the time
        does not count
    begin : float, s, when the first pose is read: later than zero after those of a plan to extend
    needs : what effects ask for of it, of :data:`doe.problem.request.PLANNED`
    """

    sided: Mask
    sizes: Array
    times: Array
    begin: float
    needs: frozenset[str]

    @property
    def dimensions(self) -> int:
        """Numbers that choose a last move: of each joint the side and, where it counts, the size."""
        return int(self.sided.sum()) * min(2, len(self.sizes))

    @property
    def timed(self) -> bool:
        """Whether the time counts."""
        return len(self.times) > 0

    def counts(self, poses: int) -> IntArray:
        """Poses at each moment, (k,), of so many."""
        ends = np.arange(len(self.times) + 1) * poses // len(self.times)
        return np.diff(ends)

    def visits(self, cell: Cell, q: Array, even: Array, start: int) -> Visits:
        """Candidates (n, dof) with last moves and moments, these in turn.

        even : ndarray, shape (n, ``dimensions``), in [0, 1); start : int, how many went before
        """
        found = Visits(q)
        if self.sided.any():
            found = replace(found, move=self._moves(cell, q, even))
        if self.timed:
            moment = np.arange(start, start + len(q)) % len(self.times)
            found = replace(found, moment=moment, time=self.times[moment])
        return found

    def _moves(self, cell: Cell, q: Array, even: Array) -> Array:
        """Last moves (n, dof) to joint values, by numbers as :meth:`visits` has them."""
        count, joints = int(self.sided.sum()), np.flatnonzero(self.sided)
        size = (even[:, count:] * len(self.sizes)).astype(int) if len(self.sizes) > 1 else 0
        move = np.zeros_like(q)
        sign = np.where(even[:, :count] < 0.5, -1.0, 1.0)
        move[:, joints] = sign * self.sizes[size, joints]
        return within(cell, q, move)

    def tries(self, visits: Visits, cell: Cell, turn: int) -> Visits:
        """The same poses with other last moves: a joint from its other side, or by another size.

        turn : int, whose it is, joint after joint
        """
        if visits.move is None:
            return visits.take(slice(0))
        joints, moves = np.flatnonzero(self.sided), []
        joint = joints[turn % len(joints)]
        own = visits.move[:, joint]
        sizes = self.sizes[:, joint] if len(self.sizes) > 1 else ()
        for other in (-own, *(np.sign(own) * size for size in sizes)):
            moves.append(visits.move.copy())
            moves[-1][:, joint] = other
        return joined([replace(visits, move=within(cell, visits.q, move)) for move in moves])


def within(cell: Cell, q: Array, move: Array) -> Array:
    """Last moves (n, dof) that begin within the joints' limits: from the other side where they do not.

    Zero where there is no room on either side.
    """
    low, high = cell.robot.limits.T
    for turned in (-move, np.zeros_like(move)):
        begins = q - move
        move = np.where((begins >= low) & (begins <= high), move, turned)
    return move


def choice_of(cell: Cell, request: Request) -> Choice:
    """What the model of a cell needs to know of the visits of a plan.

    Raises CalibError where the time counts and joint speeds are unknown, or what does not go with it is
    asked for.
    """
    robot, sided = cell.robot, np.zeros(cell.robot.dof, dtype=bool)
    placed = [parse_effect(text) for text in cell.effects]
    uses = [
        frozenset(catalogue()[name].uses) & PLANNED if name in catalogue() else _NOTHING
        for name, _ in placed
    ]
    needs = _NOTHING.union(*uses)
    for (_, places), own in zip(placed, uses, strict=True):
        if own & _OF_MOVES:
            sided |= np.array([places is None or joint in places for joint in robot.joints])
    sizes = np.where(robot.prismatic, LAST_MOVES[1][:, None], LAST_MOVES[0][:, None])
    timed = [name for (name, _), own in zip(placed, uses, strict=True) if own - _OF_MOVES]
    others = {
        "levels": request.levels is not None,
    }
    for other in (name for name, asked in others.items() if asked and timed):
        raise CalibError(
            f"{timed[0]} makes the time of each pose a choice, which does not go with {other}; leave "
            "one of both out"
        )
    sizes = sizes if "motion" in needs else sizes[:1]
    if not timed:
        return Choice(sided & robot.free, sizes, np.zeros(0), 0.0, needs)
    step, begin = _step(cell, timed[0]), 0.0
    if request.fixed is not None:
        begin = _end(request.fixed, timed[0]) + step
    return Choice(sided & robot.free, sizes, begin + _moments(request.poses, step), begin, needs)


def _moments(poses: int, step: float) -> Array:
    """When the poses are read, or as many at a time as there are too many: evenly over the day [s]."""
    count = min(poses, _MOST_MOMENTS)
    ends = np.arange(count + 1) * poses / count
    return step * 0.5 * (ends[:-1] + ends[1:] - 1.0)


def _end(fixed: Poses, effect: str) -> float:
    """When the last pose of a plan to extend is read, s since its first."""
    if fixed.time is None:
        raise CalibError(
            f"{effect} depends on the time of a reading, and the plan to extend does not say when its "
            "poses are read; give its column time_s"
        )
    return float(fixed.elapsed.max())


def _step(cell: Cell, effect: str) -> float:
    """From pose to pose [s]; those in order are half as far apart as those by chance, or about so."""
    if not paced(cell):
        raise CalibError(
            f"{effect} depends on the time of a reading, and not all joint speeds are known; give "
            "[robot.speed_deg_s] (or [robot.speed_mm_s]) in the cell"
        )
    q = cell.robot.sobol(64)
    between = 0.5 * float(np.median(durations(cell, np.diff(q, axis=0))))
    return between + cell.pace.standing(cell.load is not None)
