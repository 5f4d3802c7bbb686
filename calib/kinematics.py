"""Forward kinematics with displaced frames, and the spatial columns its derivatives are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.robot import Robot
from calib.se3 import Array, cross, rotate, so3_exp, so3_right_jacobian


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames 0 (base) .. n + 1 (tip) of the displaced arm, in base axes.

    R : ndarray, shape (..., m, n + 2, 3, 3), frames after their displacement, before joint motion
    R_before : the same before the displacement: the axes in which its translation acts
    R_link : the same after joint motion: the frames that carry the links and their weights
    o : ndarray, shape (..., m, n + 2, 3), m, origins after the displacement
    xi : ndarray, shape (..., m, n + 2, 6), the displacements, m and rad
    """

    R: Array
    R_before: Array
    R_link: Array
    o: Array
    xi: Array


def forward(robot: Robot, q: Array, xi: Array | None = None) -> Frames:
    """Frames of ``prod_k [C_k D(xi_k) exp(a_k q_k)] C_tip D(xi_tip)``, preceded by ``D(xi_0)``.

    q : ndarray, shape (m, n), rad or m
    xi : ndarray, shape (..., m, n + 2, 6), m and rad, displacement of each frame; None for none
    """
    m, frames = len(q), robot.dof + 2
    xi = np.zeros((m, frames, 6)) if xi is None else xi
    batch = xi.shape[:-2]
    D = so3_exp(xi[..., 3:])
    R = np.empty((*batch, frames, 3, 3))
    R_before, R_link = np.empty_like(R), np.empty_like(R)
    o = np.empty((*batch, frames, 3))
    rotation: Array = np.broadcast_to(np.eye(3), (*batch, 3, 3))
    origin: Array = np.zeros((*batch, 3))
    for k in range(frames):
        if k > 0:
            C = robot.origins[k - 1]
            origin = origin + rotate(rotation, C[:3, 3])
            rotation = rotation @ C[:3, :3]
        R_before[..., k, :, :] = rotation
        origin = origin + rotate(rotation, xi[..., k, :3])
        rotation = rotation @ D[..., k, :, :]
        R[..., k, :, :], o[..., k, :] = rotation, origin
        if 0 < k <= robot.dof:
            motion = robot.axes[k - 1] * q[:, k - 1, None]
            if robot.prismatic[k - 1]:
                origin = origin + rotate(rotation, motion)
            else:
                rotation = rotation @ so3_exp(motion)
        R_link[..., k, :, :] = rotation
    return Frames(R, R_before, R_link, o, xi)


def link_origins(robot: Robot, frames: Frames, q: Array) -> Array:
    """Origins of the frames that carry the links, shape (..., m, n + 2, 3): prismatic travel in."""
    travel = np.zeros((len(q), robot.dof + 2, 3))
    travel[:, 1:-1] = robot.prismatic[:, None] * robot.axes * q[:, :, None]
    return frames.o + rotate(frames.R, travel)


def spatial_columns(frames: Frames, frame: int, basis: Array) -> Array:
    """Velocity field of the arm beyond a frame, for each column of displacement there.

    A displacement ``basis @ d`` of the frame moves a point x beyond it by ``A + phi x x``.

    basis : ndarray, shape (..., m or 1, 6, p), d xi / d parameter
    Returns ndarray, shape (..., m, p, 6): (A, phi) in base axes.
    """
    turn = frames.R[..., frame, :, :] @ so3_right_jacobian(frames.xi[..., frame, 3:])
    phi = np.swapaxes(turn @ basis[..., 3:, :], -1, -2)
    slide = np.swapaxes(frames.R_before[..., frame, :, :] @ basis[..., :3, :], -1, -2)
    A = slide - cross(phi, frames.o[..., frame, None, :])
    return np.concatenate(np.broadcast_arrays(A, phi), axis=-1)


def point_velocity(columns: Array, points: Array) -> Array:
    """``A + phi x point`` for columns (..., p, 6) and points (..., p or 1, 3)."""
    return columns[..., :3] + cross(columns[..., 3:], points)
