"""Denavit-Hartenberg tables: four numbers a joint, in both conventions, and the chain that they mean.

A joint is ``J = Rz(theta) Tz(d)``, with the joint's own motion added to theta or d. A link is ``L =
Tx(a) Rx(alpha) Ry(beta)``; beta is 0 in a table of Denavit and Hartenberg, and is what Hayati and
Mirmirani (1985) added for axes that are nearly parallel, where no common normal lies near the arm.
"""

from __future__ import annotations

import numpy as np

from calib.arm.robot import Convention, Robot
from calib.arm.se3 import transform
from calib.arrays import Array, Mask


def robot_of_dh(
    convention: Convention,
    names: tuple[str, str, str],
    joints: tuple[str, ...],
    prismatic: Mask,
    *,
    alpha: Array,
    a: Array,
    theta: Array,
    d: Array,
    beta: Array,
) -> Robot:
    """The chain of a table of n rows, from its first frame to its last, without limits and masses.

    Each joint's own motion commutes with its J: the frame of a modified joint is that of its row, the
    frame of a classic one that of the row before, as both conventions number them.

    convention : ``classic`` (Paul), a row is ``J L``, the link beyond its joint; ``modified`` (Craig),
        a row is ``L J``, the link before its joint
    names : of the robot, its base and its tip; prismatic : ndarray of bool, shape (n,)
    alpha, a, beta, theta, d : ndarrays, shape (n,), rad and m, at zero reading
    """
    zero, end = np.zeros_like(a), np.eye(4)[None]
    turned = _about(0, alpha) @ _about(1, beta)
    links = transform(turned, np.stack([a, zero, zero], axis=-1))
    moved = transform(_about(2, theta), np.stack([zero, zero, d], axis=-1))
    if convention == "classic":
        origins = np.concatenate([end, moved @ links])
    else:
        origins = np.concatenate([links @ moved, end])
    return Robot.of_geometry(names[0], names[1:], joints, prismatic, origins)


def _about(i: int, angle: Array) -> Array:
    """Rotations about a coordinate axis, whose right angles are exact to the last digit but one."""
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., i, i] = 1.0
    R[..., j, j] = R[..., k, k] = np.cos(angle)
    R[..., k, j] = np.sin(angle)
    R[..., j, k] = -R[..., k, j]
    return R
