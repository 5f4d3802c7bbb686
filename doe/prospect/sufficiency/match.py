"""Which readings of a plan the data already hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.api import readings
from calib.arm.statics import wrench_with_load
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.poses import Poses
from calib.poses.visits import alike, visits

_AS_TOLD = np.radians(0.01)  # rad: robots go where they are told, and plans are rounded to this
_AS_TOLD_M = 1e-5
_AS_NAMED = np.radians(5.0)  # rad: a pose that was moved a little for want of room
_AS_NAMED_M = 0.05


@dataclass(frozen=True, eq=False)
class Match:
    """The readings of a plan against those of the data.

    left : ndarray of int, readings of ``calib.readings(cell, plan)`` that are still to come
    poses : int, poses of the plan of which nothing is left
    warnings : tuple of str
    """

    left: IntArray
    poses: int
    warnings: tuple[str, ...]


def match(cell: Cell, plan: Poses, data: Poses) -> Match:
    """Find the readings of a plan in the data: by joints, or by name where the joints are near.

    However often a pose was read before the arm went on, it counts once, unless the readings carry
    different names of the plan. So a reference is to come as often as it was not yet measured.
    """
    wanted, count = readings(cell, plan), len(plan)
    if not count:
        return Match(np.zeros(0, dtype=int), 0, ())
    plain = np.array(plan.names * (len(wanted) // count), dtype=object)
    named = np.array([(plain == n) | (np.array(wanted.names) == n) for n in data.names])
    off = np.abs(wanted.q - data.q[:, None])
    there = np.all(off <= np.where(cell.robot.prismatic, _AS_TOLD_M, _AS_TOLD), axis=-1)
    near = np.all(off <= np.where(cell.robot.prismatic, _AS_NAMED_M, _AS_NAMED), axis=-1)
    given, hung = (wrench_with_load(cell.robot, cell.gravity, poses) for poses in (data, wanted))
    fits = _equally_loaded(given[:, :3], hung[:, :3])
    left, warnings = np.ones(len(wanted), dtype=bool), []
    for one in _counted(data, np.any(named, axis=1)):
        score = (left & fits[one]) * (2 * there[one] + (named[one] & near[one]))
        best = int(score.argmax())
        if score[best] > 0:
            left[best] = False
        if score[best] == 1:
            warnings.append(f"{data.names[one]} was measured beside the plan's joints: it counts")
        elif (left & fits[one] & named[one] & ~near[one]).any() and not score[best]:
            warnings.append(
                f"{data.names[one]} stands in the plan at quite other joints: is it the right plan?"
            )
    whole = ~left.reshape(-1, count).any(axis=0)
    return Match(np.flatnonzero(left), int(whole.sum()), tuple(warnings))


def _counted(data: Poses, known: Mask) -> list[int]:
    """Readings that may be the plan's: the first of each stay and load, and all known by name."""
    keys = np.column_stack([visits(data), alike(data)])
    _, first = np.unique(keys, axis=0, return_index=True)
    rest = np.setdiff1d(np.flatnonzero(known), first)
    return [int(i) for i in (*first, *rest)]


def _equally_loaded(given: Array, wanted: Array) -> Mask:
    """Whether the arm is as loaded as it should be, (m, n): free or loaded, not to the newton."""
    lengths = (np.linalg.norm(forces, axis=1) for forces in (given, wanted))
    least = 0.5 * np.maximum.outer(*lengths)
    return np.asarray(np.linalg.norm(given[:, None] - wanted, axis=-1) <= least)
