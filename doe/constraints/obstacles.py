"""Bodies that stand still around the arm, and the floor.

The capsules of the arm and of the tool must keep clear of them. Those of the base need not: they
never move, so nothing could be chosen to keep them clear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.planned import Ball, Body, Box, HalfSpace
from doe.constraints.distances import (
    point_box,
    point_segment,
    segment_box,
    segment_halfspace,
)
from doe.constraints.scene import Clearance, Scene, probe_scene

_ALWAYS = 0.99  # of the configurations of the probe


@dataclass(frozen=True, eq=False)
class Obstacle(Clearance):
    """A body at rest in the base frame; margin : float, m, that the arm keeps of it."""

    name: str
    body: Body
    margin: float = 0.0

    def from_segment(self, start: Array, end: Array) -> Array:
        """Distance of segments (..., 3), shape (...), m; zero where they meet."""
        match self.body:
            case Box(T, half):
                return segment_box(_local(T, start), _local(T, end), half)
            case Ball(centre, radius):
                return np.maximum(point_segment(centre, start, end) - radius, 0.0)
            case HalfSpace(point, normal):
                return segment_halfspace(start, end, point, normal)

    def from_point(self, point: Array) -> Array:
        """Distance of n points (n, 3), shape (n,), m, as :meth:`from_segment` has it; zero inside."""
        if isinstance(self.body, Box):
            return point_box(_local(self.body.T_base_box, point), self.body.half)
        return self.from_segment(point, point)

    @property
    def ball(self) -> tuple[Array, float] | None:
        """Centre (3,) and radius [m] of a ball that holds it; None for what has no end."""
        match self.body:
            case Box(T, half):
                return T[:3, 3], float(np.linalg.norm(half))
            case Ball(centre, radius):
                return centre, radius
            case HalfSpace():
                return None

    def allows(self, scene: Scene) -> Mask:
        # Most shapes are far: balls around them tell it at a fraction of the cost.
        free = np.ones(len(scene), dtype=bool)
        for capsule in scene.capsules:
            if capsule.moves:
                far = capsule.reach + self.margin
                near = np.flatnonzero(free & (self.from_point(capsule.centre) <= far))
                kept = capsule.radius + self.margin
                free[near] = self.from_segment(capsule.start[near], capsule.end[near]) > kept
        return free


def _local(T_base_box: Array, point: Array) -> Array:
    return np.asarray((point - T_base_box[:3, 3]) @ T_base_box[:3, :3])


_KINDS = {Box: "box", Ball: "sphere", HalfSpace: "halfspace"}


def obstacles_of(cell: Cell) -> tuple[Obstacle, ...]:
    """The obstacles of a cell, each a constraint of its own."""
    bodies, margin = enumerate(cell.design.obstacles, 1), cell.design.margin
    return tuple(
        Obstacle(f"obstacle {i} ({_KINDS[type(body)]})", body, margin) for i, body in bodies
    )


@dataclass(frozen=True, eq=False)
class Floor(Clearance):
    """Capsules and markers of the arm stay above a height.

    height : float, m, along the base's z axis; margin : float, m, that the arm keeps above it
    checked : positions in ``Scene.capsules``; exempt : names of capsules that reach below it
        practically everywhere: a column that turns in its base, or a coarse shape
    """

    height: float
    checked: tuple[int, ...]
    exempt: tuple[str, ...] = ()
    margin: float = 0.0
    name: str = "floor"

    def allows(self, scene: Scene) -> Mask:
        heights = [_lowest(scene, self.checked), scene.markers[..., 2]]
        above = np.concatenate(heights, axis=1) - (self.height + self.margin)
        return np.asarray((above > 0.0).all(axis=1))


def _lowest(scene: Scene, which: Sequence[int]) -> Array:
    """Height of the lowest point of some capsules, shape (n, C), m."""
    own = [scene.capsules[i] for i in which]
    lowest = [np.minimum(c.start[:, 2], c.end[:, 2]) - c.radius for c in own]
    return np.stack(lowest, axis=1) if own else np.zeros((len(scene), 0))


def floor_of(cell: Cell) -> Floor | None:
    """The floor that the cell gives; None without one."""
    height = cell.design.floor
    if height is None:
        return None
    probe, margin = probe_scene(cell), cell.design.margin
    moving = [i for i, capsule in enumerate(probe.capsules) if capsule.moves]
    lowest = _lowest(probe, moving)
    kept = (lowest > height + margin).mean(axis=0) > 1.0 - _ALWAYS
    checked = [i for i, above in zip(moving, kept, strict=True) if above]
    exempt = [probe.capsules[i].name for i in moving if i not in checked]
    return Floor(height, tuple(checked), tuple(exempt), margin)
