"""The floor, or the table, that the robot stands on: the arm keeps above it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from doe.constraints.protocol import Constraint
from doe.constraints.scene import Scene, probe_scene

_ALWAYS = 0.99  # of the configurations of the probe
_UPRIGHT = 0.999  # cosine


@dataclass(frozen=True, eq=False)
class Floor(Constraint):
    """Capsules and markers of the arm stay above a height.

    height : float, m, along the base's z axis
    checked : positions in ``Scene.capsules``; exempt : names of capsules that reach below it
        practically everywhere: a column that turns in its base, or a coarse shape
    assumed : whether nobody gave the height
    """

    height: float
    checked: tuple[int, ...]
    exempt: tuple[str, ...] = ()
    assumed: bool = False
    name: str = "floor"

    def allows(self, scene: Scene) -> Mask:
        free = (scene.markers[..., 2] > self.height).all(axis=1)
        for i in self.checked:
            free &= above(scene, i, self.height)
        return np.asarray(free)


def above(scene: Scene, i: int, height: float) -> Mask:
    """Whether all of a capsule is above a height, shape (n,)."""
    capsule = scene.capsules[i]
    lowest: Array = np.minimum(capsule.start[:, 2], capsule.end[:, 2]) - capsule.radius
    return np.asarray(lowest > height)


def floor_of(cell: Cell) -> Floor | None:
    """The floor that the cell gives, or that the robot's own shape stands on; None without either."""
    given = cell.design.floor
    height = assumed_height(cell) if given is None else given
    if height is None:
        return None
    probe = probe_scene(cell)
    moving = [i for i, capsule in enumerate(probe.capsules) if capsule.moves]
    checked = [i for i in moving if above(probe, i, height).mean() > 1.0 - _ALWAYS]
    exempt = [probe.capsules[i].name for i in moving if i not in checked]
    return Floor(height, tuple(checked), tuple(exempt), given is None)


def assumed_height(cell: Cell) -> float | None:
    """Where the shape of an upright base ends below, by the robot's file, base frame [m].

    None where the file does not tell, the cell says that there is no floor, or gives shapes itself.
    """
    pull = float(np.linalg.norm(cell.gravity))
    upright = bool(pull) and -cell.gravity[2] > _UPRIGHT * pull
    assumable = upright and cell.shapes.own and not cell.design.floorless
    return cell.shapes.stands_at if assumable else None
