"""Denavit-Hartenberg tables: four numbers a joint, in both conventions, and the chain that they mean.

A joint is ``J = Rz(theta) Tz(d)``, with the joint's own motion added to theta or d. A link is ``L =
Tx(a) Rx(alpha) Ry(beta)``; beta is 0 in a table of Denavit and Hartenberg, and is what Hayati and
Mirmirani (1985) added for axes that are nearly parallel, where no common normal lies near the arm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import Literal

import numpy as np

from calib.arm.robot import Convention, Robot
from calib.arm.se3 import inverse, rotate, so3_log, transform, transformed
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


def frames_at_zero(origins: Array) -> Array:
    """Frames 1 .. n + 1 of a chain at zero reading, in the base: products of its constants."""
    chain = reduce(lambda T, C: [*T, T[-1] @ C], origins, [np.eye(4)])
    return np.array(chain[1:])


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


# -- the table of a given chain: common normals, near another table -------------------------------

_PARALLEL = 0.05  # sine of the angle below which the foot of the common normal says nothing
_COINCIDENT = 1e-9  # m
_ROUNDING = 1e-13  # m or rad
_STEP = 1e-6  # of the differences by which the last row is fitted
_ROUNDS = 8


def dh_of_robot(robot: Robot, near: DhTable) -> DhTable:
    """The table of a robot whose numbers are near those of another table of the same arm.

    Where axes are not parallel their common normal tells the row. Where they nearly are, d stays where
    it is, the foot of the normal might be a kilometre away, and beta takes the tilt about y.
    """
    table, n = near, robot.dof
    frames = frames_at_zero(robot.origins)
    z = np.concatenate([rotate(frames[:n, :3, :3], robot.axes), frames[n:, :3, 2]])
    points = _points(frames, z, table)
    classic = table.convention == "classic"
    theta, d = table.theta.copy(), table.d.copy()
    alpha, a, beta = table.alpha.copy(), table.a.copy(), table.beta.copy()
    F = frames[0] @ inverse(robot.origins[0]) @ table.links[0]
    for k in range(n - 1):  # the last link is fitted to the tip
        row = k if classic else k + 1
        theta[k], d[k], alpha[row], a[row], beta[row] = _normal(
            inverse(F), points[k + 1], z[k + 1], theta[k], alpha[row], d[k]
        )
        F = F @ joint(theta[k], d[k]) @ link(alpha[row], a[row], beta[row])
    own = np.array([theta[-1], d[-1], *((alpha[-1], a[-1]) if classic else ())])
    fixed = beta[-1] if classic else 0.0
    goal = inverse(F) @ frames[n]
    own = _nearest(own, fixed, goal, robot.reach)
    theta[-1], d[-1] = own[:2]
    if classic:
        alpha[-1], a[-1] = own[2:]
    return replace(
        table,
        theta=_without_dust(theta, table.theta),
        d=_without_dust(d, table.d),
        alpha=_without_dust(alpha, table.alpha),
        a=_without_dust(a, table.a),
        beta=_without_dust(beta, table.beta),
    )


def _without_dust(values: Array, near: Array) -> Array:
    return np.where(np.abs(values - near) < _ROUNDING, near, values)


def _points(frames: Array, z: Array, table: DhTable) -> Array:
    """A point on each axis, and the tip.

    An axis that slides may lie anywhere: where the table has it on the next axis, it stays there.
    """
    points: Array = frames[:, :3, 3].copy()
    first = 0 if table.convention == "classic" else 1
    for k in reversed(np.flatnonzero(table.prismatic[:-1])):
        parallel = np.linalg.norm(np.cross(z[k], z[k + 1])) < _PARALLEL
        if parallel and abs(table.a[k + first]) < _COINCIDENT:
            offset = points[k + 1] - points[k]
            points[k] += offset - z[k] * (z[k] @ offset)
    return points


def _normal(
    to_axis: Array, point: Array, z: Array, theta0: float, alpha0: float, d0: float
) -> tuple[float, float, float, float, float]:
    """(theta, d, alpha, a, beta) from a frame on one axis to the next axis, angles near those given.

    to_axis : ndarray, shape (4, 4), that takes the base to the frame; point, z : of the next axis, in
        the base; d0 : m, the foot on parallel axes
    """
    p, z = transformed(to_axis, point), rotate(to_axis[:3, :3], z)
    x = np.array([-z[1], z[0], 0.0])
    parallel = np.linalg.norm(x) < _PARALLEL
    if parallel:
        d = d0
        x = p + z * ((d - p[2]) / z[2])
        x[2] = 0.0
        if np.linalg.norm(x) < _COINCIDENT:
            x = np.array([np.cos(theta0), np.sin(theta0), 0.0])
        else:
            p = np.array([x[0], x[1], d])
    x = x / np.linalg.norm(x)
    if x @ [np.cos(theta0), np.sin(theta0), 0.0] < 0.0:
        x = -x
    if parallel:
        a = float(x @ p)
    else:
        d, a, _ = np.linalg.solve(np.column_stack([[0.0, 0.0, 1.0], x, -z]), p)
    y = np.array([-x[1], x[0], 0.0])
    alpha = np.arctan2(-(z @ y), z[2])
    beta = np.arcsin(np.clip(z @ x, -1.0, 1.0)) if parallel else 0.0
    theta = _near(np.arctan2(x[1], x[0]), theta0)
    return theta, float(d), _near(alpha, alpha0), float(a), float(beta)


def _near(angle: float, other: float) -> float:
    """The same angle, whole turns away, that is nearest to another."""
    return float(angle + 2.0 * np.pi * np.round((other - angle) / (2.0 * np.pi)))


def _last(own: Array, beta: float) -> Array:
    """J of (theta, d), or J L of (theta, d, alpha, a)."""
    T = joint(own[0], own[1])
    return T @ link(own[2], own[3], np.array(beta)) if len(own) > 2 else T


def _nearest(own: Array, beta: float, goal: Array, length: float) -> Array:
    """The last row that comes nearest to a frame; a turn counts as its arc at ``length``."""

    def off(values: Array) -> Array:
        D = inverse(_last(values, beta)) @ goal
        return np.concatenate([D[:3, 3], so3_log(D[:3, :3]) * length])

    steps = _STEP * np.eye(len(own))
    for _ in range(_ROUNDS):
        r = off(own)
        if np.abs(r).max() < 1e-12:  # m
            break
        slope = np.column_stack([(off(own + h) - off(own - h)) / (2.0 * _STEP) for h in steps])
        own = own - np.linalg.pinv(slope, rcond=1e-6) @ r
    return own
