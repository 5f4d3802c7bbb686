"""Poses at which cameras see their boards whole, drawn anywhere within the limits."""

from __future__ import annotations

import numpy as np

from calib import Cell
from calib.arrays import Array
from calib.cell.views import NUMBERS, looking, views_of
from doe.constraints import scene_of, visible

_AT_ONCE = 250  # candidates


def poses_that_show(
    cell: Cell, rng: np.random.Generator, drawn: int, count: int | None = None
) -> Array:
    """Joint values (n, dof), rad or m, at which all that cameras look at is seen.

    drawn : candidates; count : poses to end with, all that are found where None
    """
    low, high = cell.robot.sample_limits().T
    q = rng.uniform(low, high, (drawn, cell.robot.dof))
    even, free = rng.uniform(size=(drawn, NUMBERS)), np.ones(cell.robot.dof, dtype=bool)
    view = np.arange(drawn) % len(views_of(cell))
    found = q[:0]
    for first in range(0, drawn, _AT_ONCE):
        own = slice(first, first + _AT_ONCE)
        there = looking(cell, q[own], view[own], even[own], free)
        found = np.concatenate([found, there[visible(scene_of(cell, there)).all(axis=1)]])
        if count is not None and len(found) >= count:
            break
    return found[:count]
