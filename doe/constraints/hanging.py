"""Where the load of a plan hangs safely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from doe.constraints.protocol import Constraint
from doe.constraints.scene import Scene

_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class HangingLoad(Constraint):
    """The tip's x axis leaves the horizontal by no more than the load allows.

    down : ndarray, shape (3,), unit vector of gravity in base axes
    max_tilt : float, rad
    """

    down: Array
    max_tilt: float
    name: str = "hanging_load"

    def allows(self, scene: Scene) -> Mask:
        sine = np.abs(scene.frames.R[:, -1, :, 0] @ self.down)
        return np.asarray(sine <= np.sin(self.max_tilt) + _SLACK)


def hanging_load(cell: Cell) -> HangingLoad | None:
    """The limit of the cell's load; None where nothing hangs or every tilt will do."""
    pull = float(np.linalg.norm(cell.gravity))
    if cell.load is None or cell.load.max_tilt >= np.pi / 2 or not pull:
        return None
    return HangingLoad(cell.gravity / pull, cell.load.max_tilt)
