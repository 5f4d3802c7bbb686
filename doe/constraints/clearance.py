"""Constraints that keep shapes apart, and for how much of a motion they surely go on doing so.

Along a straight motion of the joints, ``q + t dq``, a point that rides on the arm moves by at most
``sum_k |dq_k| r_k`` a unit of t, with r_k the farthest that it can be from the axis of joint k. A gap
cannot close within ``gap / sum_k |dq_k| r_k`` before and after: between two configurations that are
looked at, nothing is missed (Schwarzer, Saha, Latombe, IEEE Transactions on Robotics 21(3), 2005).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from doe.constraints.scene import Constraint, Scene, named_capsules


@dataclass(frozen=True, eq=False)
class JointLevers:
    """The farthest that any point of a shape can be from each joint's axis; one for joints that slide.

    capsules : ndarray, shape (C, dof), m a rad or 1, in the order of ``Scene.capsules``
    markers : ndarray, shape (M, dof), the same of the markers
    moved : ndarray of bool, shape (F, dof), which joints move each body
    """

    capsules: Array
    markers: Array
    moved: Mask

    def between(self, one: Array, of: int, other: Array, by: int) -> Array:
        """The most that the gap of two shapes changes with each joint, (dof,).

        Joints that move both move them alike.

        one, other : ndarray, shape (dof,), their levers; of, by : the bodies that carry them
        """
        here, there = self.moved[of], self.moved[by]
        return np.where(here & ~there, one, 0.0) + np.where(there & ~here, other, 0.0)


def levers_of(cell: Cell, travel: Array) -> JointLevers:
    """Levers that hold wherever no joint is farther from zero than ``travel``, (dof,), rad or m."""
    shapes = [
        _lever(cell, body, np.array([own.start, own.end]), own.radius, travel)
        for body, _, own in named_capsules(cell)
    ]
    points = [
        _lever(cell, tip, marker[None], 0.0, travel)
        for marker, tip in zip(cell.markers, cell.marker_frames.tolist(), strict=True)
    ]
    blank, moved = np.zeros((0, cell.robot.dof)), cell.robot.carries[1 : cell.robot.dof + 1].T
    return JointLevers(np.array(shapes or blank), np.array(points or blank), moved)


def _lever(cell: Cell, body: int, points: Array, radius: float, travel: Array) -> Array:
    """Of all that is within a radius of points (k, 3) of a body's frame, to each axis, (dof,)."""
    robot = cell.robot
    steps = robot.origins[:, :3, 3]
    slid = np.zeros(len(steps))
    slid[: robot.dof] = np.where(robot.prismatic, travel, 0.0)
    lengths = np.linalg.norm(steps, axis=1) + slid
    found = np.zeros(robot.dof)
    for k in np.flatnonzero(robot.moving(body)):
        way = np.flatnonzero(robot.carries[k + 1] & robot.carries[:, body])[1:] - 1  # frames beyond
        if robot.prismatic[k]:
            found[k] = 1.0
        elif not len(way):
            found[k] = _across(points, robot.axes[k]) + radius
        else:
            first = _across(steps[way[:1]], robot.axes[k]) + slid[way[0]]
            beyond = lengths[way[1:]].sum() + np.linalg.norm(points, axis=1).max()
            found[k] = first + beyond + radius
    return found


def _across(vectors: Array, axis: Array) -> float:
    """The largest distance of points (k, 3) from an axis through the origin."""
    return float(np.linalg.norm(vectors - np.outer(vectors @ axis, axis), axis=1).max())


class Lasting(Constraint):
    """A constraint that knows for how much of a straight motion it goes on to hold."""

    @abstractmethod
    def lasts(self, scene: Scene, rates: Array, levers: JointLevers) -> Array:
        """The time before and after for which it surely holds, shape (n,); zero where it does not.

        The whole motion takes one unit of time; half of it is what is asked for at most.

        rates : ndarray, shape (n, dof), how far each joint goes in all, rad or m
        """


class Clearance(Lasting):
    """Pairs of shapes that keep apart, K of them."""

    @abstractmethod
    def gaps(self, scene: Scene) -> Array:
        """Distances beyond what is to be kept, shape (n, K), m; none is above zero where they meet."""

    @abstractmethod
    def slopes(self, levers: JointLevers) -> Array:
        """The most that each gap changes with each joint, shape (K, dof)."""

    def allows(self, scene: Scene) -> Mask:
        return np.asarray((self.gaps(scene) > 0.0).all(axis=1))

    def lasts(self, scene: Scene, rates: Array, levers: JointLevers) -> Array:
        each = lasting(self.gaps(scene), rates @ self.slopes(levers).T)
        return np.asarray(each.min(axis=1, initial=np.inf))


def lasting(gaps: Array, speeds: Array) -> Array:
    """For how long gaps that change at most at these speeds, of the same shape, stay above zero."""
    never = np.where(gaps > 0.0, np.inf, 0.0)
    return np.where(speeds > 0.0, np.maximum(gaps, 0.0) / np.maximum(speeds, 1e-300), never)


def placed(scene: Scene, which: Sequence[int]) -> tuple[Array, Array, Array]:
    """Ends (n, C, 3), m, twice and radii (C,), m, of some capsules of a scene."""
    if not which:
        blank = np.zeros((len(scene), 0, 3))
        return blank, blank, np.zeros(0)
    own = [scene.capsules[i] for i in which]
    start, end = (np.stack([getattr(c, name) for c in own], axis=1) for name in ("start", "end"))
    return start, end, np.array([c.radius for c in own])
