"""Instruments that must be touched: elsewhere they read nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Mask
from calib.cell import Cell
from calib.cell.contacts import touched
from doe.constraints.protocol import Constraint
from doe.constraints.scene import Scene


@dataclass(frozen=True)
class Touching(Constraint):
    """A marker meets something: what the solver does not bring there is out of reach."""

    name: str = "contact"

    def allows(self, scene: Scene) -> Mask:
        return np.asarray(touched(scene.cell, scene.q) >= 0)


def in_contact(cell: Cell) -> Touching | None:
    """Where all instruments are to be touched, and stand where the cell says; else None."""
    all_touch = all(i.touches and not i.unforeseen for i in cell.instruments)
    return Touching() if all_touch else None
