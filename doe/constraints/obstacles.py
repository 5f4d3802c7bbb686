"""Bodies that stand still around the arm.

The capsules of the arm and of the tool must keep clear of them. Those of the base need not: they
never move, so nothing could be chosen to keep them clear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.cell.planned import Ball, Body, Box, HalfSpace
from doe.constraints.distances import point_segment, segment_box, segment_halfspace
from doe.constraints.scene import Clearance, Scene, moving_capsules

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

    def allows(self, scene: Scene) -> Mask:
        free = np.ones(len(scene), dtype=bool)
        for capsule in (own for own in scene.capsules if own.moves):
            at = np.flatnonzero(free)
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
