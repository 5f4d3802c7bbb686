"""Denavit-Hartenberg tables: four numbers a joint, in both conventions, and the chain that they mean.

A joint is ``J = Rz(theta) Tz(d)``, with the joint's own motion added to theta or d. A link is ``L =
Tx(a) Rx(alpha) Ry(beta)``; beta is 0 in a table of Denavit and Hartenberg, and is what Hayati and
Mirmirani (1985) added for axes that are nearly parallel, where no common normal lies near the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arm.robot import Convention, Robot
from calib.arm.se3 import transform
from calib.arrays import Array


@dataclass(frozen=True, eq=False)
class DhTable:
    """A table of n rows; SI and radians.

    convention : ``classic`` (Paul), a row is ``J L``, the link beyond its joint; ``modified`` (Craig),
        a row is ``L J``, the link before its joint
    joints : tuple of str
    prismatic : ndarray of bool, shape (n,)
    alpha, a, beta : ndarray, shape (n,), of each row's link
    theta, d : ndarray, shape (n,), of each row's joint at zero reading
    """

    convention: Convention
    joints: tuple[str, ...]
    prismatic: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    alpha: Array
    a: Array
    theta: Array
    d: Array
    beta: Array

    @property
    def links(self) -> Array:
        """L_0 before the first joint .. L_n beyond the last, shape (n + 1, 4, 4)."""
        own, none = link(self.alpha, self.a, self.beta), np.eye(4)[None]
        return np.concatenate([none, own] if self.convention == "classic" else [own, none])


def link(alpha: Array, a: Array, beta: Array) -> Array:
    """``Tx(a) Rx(alpha) Ry(beta)``, shape (..., 4, 4)."""
    zero = np.zeros_like(a)
    return transform(_about("x", alpha) @ _about("y", beta), np.stack([a, zero, zero], axis=-1))


def joint(theta: Array, d: Array) -> Array:
    """``Rz(theta) Tz(d)``, shape (..., 4, 4)."""
    zero = np.zeros_like(d)
    return transform(_about("z", theta), np.stack([zero, zero, d], axis=-1))


def robot_of_dh(table: DhTable, name: str, base: str, tip: str) -> Robot:
    """The chain of a table, from its first frame to its last, without limits and masses.

    Each joint's own motion commutes with its J: the frame of a modified joint is that of its row, the
    frame of a classic one that of the row before, as both conventions number them.
    """
    links, joints = table.links, joint(table.theta, table.d)
    if table.convention == "classic":
        origins = np.concatenate([links[:1], joints @ links[1:]])
    else:
        origins = np.concatenate([links[:-1] @ joints, links[-1:]])
    return Robot.of_geometry(name, (base, tip), table.joints, table.prismatic, origins)


def _about(axis: Literal["x", "y", "z"], angle: Array) -> Array:
    """Rotations about a coordinate axis, whose right angles are exact to the last digit but one."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., i, i] = 1.0
    R[..., j, j] = R[..., k, k] = np.cos(angle)
    R[..., k, j] = np.sin(angle)
    R[..., j, k] = -R[..., k, j]
    return R
