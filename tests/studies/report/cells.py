"""Cells to draw: the embedded one, with a shape, an instrument and things in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import Cell
from calib.arm.robot import Capsule, Shapes
from calib.cell.planned import Planned
from tests.helpers import designed, read_by

HOSTILE = "</script><script>alert(1)</script><!--\"'><img src=x onerror=alert(2)>&lt;"


def shaped(cell: Cell) -> Cell:
    """Capsules along the arm, an instrument beside it, one obstacle of each kind, and the floor."""
    obstacles = [
        {
            "type": "box",
            "center_mm": (1900, -1500, 400),
            "size_mm": (600, 500, 800),
            "rpy_deg": (0, 0, 20),
        },
        {"type": "sphere", "center_mm": (-900, 1800, 500), "radius_mm": 300},
        {"type": "halfspace", "point_mm": (0, 0, 0), "normal": (0, 0, -1)},
        {"type": "halfspace", "point_mm": (-2000, 0, 0), "normal": (-2, 0, 1)},
    ]
    return replace(
        cell,
        design=replace(cell.design, obstacles=designed(cell, obstacle=obstacles).design.obstacles),
        instruments=read_by(stands=np.array([3.4, -2.6, 1.5])),
        shapes=Shapes(
            {
                "base": (Capsule((0.0, 0.0, 0.1), (0.0, 0.0, 0.5), 0.33),),
                "A2": (Capsule((0.0, 0.0, 0.0), (1.25, 0.0, 0.0), 0.2),),
                "A3": (
                    Capsule((0.0, 0.0, 0.0), (0.6, 0.0, -0.05), 0.22),
                    Capsule((0.6, 0.0, -0.05), (1.1, 0.0, -0.055), 0.14),
                ),
                "tool": (Capsule((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), 0.1),),
            }
        ),
    )


def hostile(cell: Cell) -> Cell:
    """Names that would break out of HTML, of a script or of a comment."""
    return replace(
        cell,
        name=HOSTILE,
        robot=replace(cell.robot, joints=tuple(f"{j}{HOSTILE}" for j in cell.robot.joints)),
        marker_names=tuple(f"{m}{HOSTILE}" for m in cell.marker_names),
        effects=("base", "tool"),
        design=Planned(),
    )
