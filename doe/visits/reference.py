"""A reference pose, measured again and again through the day: what shows that something drifts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.errors import CalibError
from calib.poses import Poses
from doe.constraints import scene_of, visible
from doe.problem import Problem


@dataclass(frozen=True)
class Reference:
    """A pose of the plan and its repeats.

    pose : str, the plan's own; every : int, poses between two repeats
    repeats : tuple of str, ref1, ref2 .., each a pose of the plan with the same joints
    """

    pose: str
    every: int
    repeats: tuple[str, ...]


def spacing(cell: Cell, every: int | None) -> int:
    """Poses between two readings of the reference, 0 for no reference; the cell's if None.

    Raises CalibError.
    """
    found = cell.design.reference_every if every is None else every
    if found is not None and found < 0:
        raise CalibError(f"a reference every {found} poses cannot be; ask for 1 or more, or 0")
    return int(found or 0)


def with_reference(
    problem: Problem, poses: Poses, every: int, busy: Collection[str] = ()
) -> tuple[Poses, Reference]:
    """The poses with a reference at the start, after every so many, and at the end.

    busy : names of poses that are visited again anyway; the reference is none of them
    """
    m = len(poses)
    before = np.append(np.arange(0, m, every), m)
    repeats = tuple(f"ref{k + 1}" for k in range(len(before)))
    may = np.array([name not in busy for name in poses.names])
    chosen = int(np.flatnonzero(may)[reference_pose(problem, poses.q, len(repeats), may)])
    order = np.insert(np.arange(m), before, chosen)
    names = np.insert(np.array(poses.names, dtype=object), before, repeats)
    reference = Reference(poses.names[chosen], every, repeats)
    return replace(poses.take(order), names=tuple(names)), reference


def reference_pose(problem: Problem, q: Array, repeats: int, may: Mask) -> int:
    """Of the poses (m, dof) that show the most markers, the one whose repeats add most.

    may : ndarray of bool, shape (m,), the poses to choose from; the result counts these alone
    """
    blocks = problem.information(q)
    M = problem.fixed + blocks.sum(axis=0)
    q, blocks = q[may], blocks[may]
    value = problem.criterion.plain.value(M + repeats * blocks)
    seen = visible(scene_of(problem.cell, q)).sum(axis=1)
    return int(np.where(seen == seen.max(), value, -np.inf).argmax())
