"""The arm keeps clear of itself."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.arrays import Mask
from calib.cell import Cell
from doe.constraints.distances import segment_segment
from doe.constraints.scene import (
    Clearance,
    PlacedCapsule,
    Scene,
    moving_capsules,
    named_capsules,
    probe_scene,
    scene_of,
)

_ALWAYS = 0.99  # of the configurations of the probe
_REMEDY = "Put the meshes where the robot file says, or give robot.capsules_mm in the cell."


@dataclass(frozen=True, eq=False)
class SelfCollision(Clearance):
    """Capsules of bodies of which neither carries the other next to it do not meet.

    Pairs that overlap practically everywhere, as at a spherical wrist, say that the shapes are
    coarse and not that the arm is in danger; they are exempt, as in MoveIt's setup assistant. So are
    those of one branch whose shapes meet at the zero pose, which no maker draws in collision: capsules
    hold more than the shapes. Two hands that meet there are in danger all the same.

    pairs : tuple of pairs of positions in ``Scene.capsules``, those that are checked
    exempt : tuple of pairs of capsule names, those that are not checked
    """

    pairs: tuple[tuple[int, int], ...]
    exempt: tuple[tuple[str, str], ...] = ()
    name: str = "self_collision"

    def allows(self, scene: Scene) -> Mask:
        free = np.ones(len(scene), dtype=bool)
        for i, j in self.pairs:
            free &= ~overlap(scene.capsules[i], scene.capsules[j], free)
        return free


def clear_of_itself(cell: Cell) -> SelfCollision | None:
    """The pairs of a cell's capsules that can meet; None where no two bodies could."""
    bodies, robot = [body for body, _, _ in named_capsules(cell)], cell.robot
    near = {(parent, body) for body, parent in enumerate(robot.parents, 1)}
    pairs = [
        (i, j)
        for i, j in combinations(range(len(bodies)), 2)
        if bodies[i] != bodies[j] and (bodies[i], bodies[j]) not in near
    ]
    if not pairs:
        return None
    probe = probe_scene(cell)
    zero = scene_of(cell, robot.tied(np.clip(np.zeros((1, robot.dof)), *robot.sample_limits().T)))

    def touches(i: int, j: int) -> bool:
        """Whether a pair is exempt."""
        a, b = bodies[i], bodies[j]
        one_branch = cell.shapes.own and (robot.carries[a, b] or robot.carries[b, a])
        at_zero, everywhere = (overlap(s.capsules[i], s.capsules[j]) for s in (zero, probe))
        return bool((one_branch and at_zero.all()) or everywhere.mean() >= _ALWAYS)

    exempt = [pair for pair in pairs if touches(*pair)]
    names = tuple((probe.capsules[i].name, probe.capsules[j].name) for i, j in exempt)
    return SelfCollision(tuple(pair for pair in pairs if pair not in exempt), names)


def overlap(a: PlacedCapsule, b: PlacedCapsule, among: Mask | bool = True) -> Mask:
    """Whether two capsules meet, shape (n,); False where ``among`` is."""
    # Most pairs are far apart: balls around them tell it at a fraction of the cost.
    between = a.centre - b.centre
    near = np.einsum("ni,ni->n", between, between) <= (a.reach + b.reach) ** 2
    at = np.flatnonzero(near & among)
    met = np.zeros(len(near), dtype=bool)
    distance = segment_segment(a.start[at], a.end[at], b.start[at], b.end[at])
    met[at] = distance <= a.radius + b.radius
    return met


def unchecked(cell: Cell) -> str:
    """That poses are not checked for collisions, or only in part, and what to do; "" where they are."""
    moving = moving_capsules(cell)
    if unread := cell.shapes.unread:
        more = f", and {len(unread) - 1} more" if len(unread) > 1 else ""
        part = "only in part" if moving else "not"
        what = f"shapes cannot be read: {unread[0]}{more}"
        return f"The poses are {part} checked for collisions, as {what}. {_REMEDY}"
    if moving:
        return ""
    return (
        "The poses are not checked for collisions, as the arm has no shape. Give "
        "robot.capsules_mm in the cell."
    )
