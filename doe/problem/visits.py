"""Candidates of a plan: where the arm stands, from where each joint comes, and when it is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.poses import Poses, poses_at


@dataclass(frozen=True, eq=False)
class Visits:
    """n visits of the arm.

    q : ndarray, shape (n, dof), rad or m
    move : ndarray, shape (n, dof), rad or m, the last move of each joint with its sign; None where
        nothing depends on it
    moment : ndarray of int, shape (n,), which of the moments of the day; time : ndarray, shape (n,), s
        since the first reading; both None where nothing depends on it
    """

    q: Array
    move: Array | None = None
    moment: IntArray | None = None
    time: Array | None = None

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def of(cls, poses: Poses) -> Visits:
        """Those of a plan, in its order."""
        told = poses.approach is not None and poses.motion is not None
        move = np.multiply(poses.approach, poses.motion) if told else None  # type: ignore[arg-type]
        return cls(poses.q, move, time=None if poses.time is None else poses.elapsed)

    def take(self, index: Any) -> Visits:
        """The visits of an index array or mask."""
        others = {name: own[index] for name, own in vars(self).items() if own is not None}
        return Visits(**others)

    def poses(self, cell: Cell) -> Poses:
        """As readings, without names."""
        told: dict[str, Any] = {}
        if self.move is not None:
            told = {"approach": np.sign(self.move), "motion": np.abs(self.move)}
            told["motion_told"] = True
        if self.time is not None:
            told |= {"time": self.time, "temperature": cell.pace.temperature(self.time)}
        return poses_at(self.q, names=[""] * len(self), **told)


def joined(parts: Sequence[Visits]) -> Visits:
    """Visits of one kind, one part after the other."""
    told = [name for name, own in vars(parts[0]).items() if own is not None]
    return Visits(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in told})
