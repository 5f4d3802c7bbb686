"""The weight of the payload, given in the cell and in the table's wrench once more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.statics import wrench_with_load
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import InputError
from calib.poses import Poses, hung

_SAME = 0.01  # of the weight


def refuse_payload_twice(cell: Cell, path: Path, poses: Poses) -> None:
    """Refuse readings that bear the cell's payload as their wrench. Raises InputError."""
    loaded = poses.take(poses.wrench.any(axis=1))
    if not cell.payload.mass or not len(loaded):
        return
    free = replace(loaded, wrench=np.zeros_like(loaded.wrench))
    carried = hung(free, cell.payload.mass, cell.payload.com)
    weight = wrench_with_load(cell.robot, cell.gravity, carried)
    moment = loaded.wrench[:, 3:]
    if _alike(loaded.wrench[:, :3], weight[:, :3]) and (
        not moment.any() or _alike(moment, weight[:, 3:])
    ):
        raise InputError(
            path,
            "columns of the wrench",
            f"hold the weight of the cell's [payload], {cell.payload.mass:g} kg, once more",
            "a load counts once: take [payload] out of the cell, or these columns out of the table",
        )


def _alike(found: Array, expected: Array) -> bool:
    off = np.linalg.norm(found - expected, axis=1)
    return bool((off <= _SAME * np.linalg.norm(expected, axis=1)).all())
