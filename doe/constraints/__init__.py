"""What a configuration must satisfy to be measured, and which markers are seen there."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, TextArray
from calib.cell import Cell
from doe.constraints.limits import hanging_load, joint_limits, joint_torque
from doe.constraints.obstacles import obstacles_of
from doe.constraints.scene import Clearance, Constraint, Scene, scene_of
from doe.constraints.self_collision import clear_of_itself
from doe.constraints.sight import read_by, visible

__all__ = [
    "Constraint", "Scene", "broken_at", "constraints_of", "read_by", "scene_of", "visible",
]  # fmt: skip


def constraints_of(cell: Cell) -> tuple[Constraint, ...]:
    """Constraints that can act in a cell, the cheap ones first."""
    every = (
        joint_limits(cell),
        *obstacles_of(cell, of_the_arm=True),
        clear_of_itself(cell),
        hanging_load(cell),
        joint_torque(cell),
    )
    return tuple(constraint for constraint in every if constraint is not None)


def broken_at(cell: Cell, q: Array) -> TextArray:
    """What the arm meets at each pose (n, dof), "" where nothing, shape (n,)."""
    scene, met = scene_of(cell, q), np.full(len(q), "", dtype=object)
    for constraint in reversed(constraints_of(cell)):
        if isinstance(constraint, Clearance):
            met[~constraint.allows(scene)] = constraint.name
    return met
