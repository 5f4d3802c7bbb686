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
from doe.constraints.distances import point_segment, segment_box, segment_halfspace
from doe.constraints.scene import Clearance, Scene, moving_capsules, probe_scene

_ALWAYS = 0.99  # of the configurations of the probe
_KINDS = {Box: "box", Ball: "sphere", HalfSpace: "halfspace"}


@dataclass(frozen=True, eq=False)
class Obstacle(Clearance):
    """A body at rest in the base frame; margin : float, m, that the arm keeps of it."""

    name: str
    body: Body
    margin: float = 0.0

    def distance(self, start: Array, end: Array) -> Array:
        """Distance of segments (..., 3), shape (...), m; zero where they meet."""
        match self.body:
            case Box(T, half):
                R, at = T[:3, :3], T[:3, 3]
                return segment_box((start - at) @ R, (end - at) @ R, half)
            case Ball(centre, radius):
                return np.maximum(point_segment(centre, start, end) - radius, 0.0)
            case HalfSpace(point, normal):
                return segment_halfspace(start, end, point, normal)

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
        for capsule in (own for own in scene.capsules if own.moves):
            near = free
            if self.ball is not None:
                centre, radius = self.ball
                away = np.linalg.norm(capsule.centre - centre, axis=1)
                near = free & (away <= radius + capsule.reach + self.margin)
            at = np.flatnonzero(near)
            clear = self.distance(capsule.start[at], capsule.end[at])
            free[at] = clear > capsule.radius + self.margin
        return free


def obstacles_of(cell: Cell, *, of_the_arm: bool = False) -> tuple[Obstacle, ...]:
    """The obstacles of a cell; of_the_arm : only where the arm has a shape that meets them."""
    bodies = () if of_the_arm and not moving_capsules(cell) else cell.design.obstacles
    return tuple(
        Obstacle(f"obstacle {i} ({_KINDS[type(body)]})", body, cell.design.margin)
        for i, body in enumerate(bodies, 1)
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
    height, margin = cell.design.floor, cell.design.margin
    if height is None:
        return None
    probe = probe_scene(cell)
    moving = [i for i, capsule in enumerate(probe.capsules) if capsule.moves]
    kept = (_lowest(probe, moving) > height + margin).mean(axis=0) > 1.0 - _ALWAYS
    exempt = [probe.capsules[i].name for i, above in zip(moving, kept, strict=True) if not above]
    checked = [i for i, above in zip(moving, kept, strict=True) if above]
    return Floor(height, tuple(checked), tuple(exempt), margin)
