"""The nominal robot: a serial chain of revolute and prismatic joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial chain, ``T_base_tip(q) = prod_k [C_k exp(a_k q_k)] C_tip``; SI and radians.

    Frames are numbered along the chain: 0 is the base, k = 1..n the frame of joint k before the
    joint moves, n + 1 the tip.

    name : str
    base, tip : str, names of the first and last link
    joints : tuple of str, the n joint names
    prismatic : ndarray of bool, shape (n,)
    origins : ndarray, shape (n + 1, 4, 4): C_1 .. C_n and C_tip
    axes : ndarray, shape (n, 3), unit vectors in the joint frames
    limits : ndarray, shape (n, 2), rad or m; infinite where none is given
    efforts : ndarray, shape (n,), N m or N; NaN where no limit is given
    masses : ndarray, shape (n,), kg of the link that moves with each joint
    coms : ndarray, shape (n, 3), m, centres of mass in the frames that move with the joints
    """

    name: str
    base: str
    tip: str
    joints: tuple[str, ...]
    prismatic: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    origins: Array
    axes: Array
    limits: Array
    efforts: Array
    masses: Array
    coms: Array

    @property
    def dof(self) -> int:
        """Number of joints, n."""
        return len(self.joints)

    @property
    def tip_frame(self) -> int:
        """Number of the tip frame, n + 1."""
        return self.dof + 1

    @cached_property
    def reach(self) -> float:
        """Sum of the constant translations [m]: the size of the arm, used to scale columns."""
        return float(np.linalg.norm(self.origins[1:, :3, 3], axis=1).sum()) or 1.0

    def sample_limits(self) -> Array:
        """Finite joint ranges, shape (n, 2): the limits, else +-pi or +-1 m."""
        fallback = np.where(self.prismatic, 1.0, np.pi)[:, None] * np.array([-1.0, 1.0])
        return np.where(np.isfinite(self.limits), self.limits, fallback)
