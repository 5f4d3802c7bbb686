"""Forward kinematics with displaced frames, and the spatial columns its derivatives are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import (
    by_one,
    cross,
    rotate,
    skew,
    so3_about,
    so3_exp,
    so3_right_jacobian,
    so3_terms,
    turned,
)
from calib.arrays import Array, IntArray, room

_UNTURNED = np.eye(3)


@dataclass(frozen=True, eq=False)
class DisplacedFrames:
    """One displacement ``D(xi)`` of every frame: the axes before it, and the frames after it.

    xi : ndarray, shape (..., m or 1, F, 6), m and rad
    R_before : ndarray, shape (..., m, F, 3, 3), axes in which its translation acts
    R : the same after it
    o : ndarray, shape (..., m, F, 3), m, origins after it
    """

    xi: Array
    R_before: Array
    R: Array
    o: Array


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of the displaced arm, base to tips, in base axes, before joint motion.

    constant : DisplacedFrames, what holds at every pose: errors of the geometry
    present : DisplacedFrames, what depends on the state: deflection, gear errors, heat
    R_link : ndarray, shape (..., m, F, 3, 3), after joint motion: the frames that carry links
    """

    constant: DisplacedFrames
    present: DisplacedFrames
    R_link: Array

    @property
    def R(self) -> Array:
        """Axes of the frames, shape (..., m, F, 3, 3)."""
        return self.present.R

    @property
    def o(self) -> Array:
        """Origins of the frames, shape (..., m, F, 3), m."""
        return self.present.o


def forward(
    robot: Robot, q: Array, constant: Array | None = None, present: Array | None = None
) -> Frames:
    """Frames of ``prod_k [C_k D(constant_k) D(present_k) exp(a_k q_k)] C_tip D D``, after ``D_0 D_0``.

    q : ndarray, shape (m, n), rad or m
    constant : ndarray, shape (..., F, 6), m and rad, displacement of each frame at every pose
    present : ndarray, shape (..., m, F, 6), m and rad, displacement at each pose
    """
    m, count = len(q), robot.frame_count
    first = np.zeros((1, count, 6)) if constant is None else constant[..., None, :, :]
    second = np.zeros((m, count, 6)) if present is None else present
    batch = (*np.broadcast_shapes(first.shape[:-3], second.shape[:-3]), m)
    moves = [_moves(xi) for xi in (first, second)]
    joints = so3_terms(robot.axes)
    # Axes: nominal, after the constant displacement, after the present one, after the joint's motion.
    # A displacement that moves no frame shares the arrays of the stage before it.
    nominal, moved = room(batch, count, 3, 3), room(batch, count, 3, 3)
    axes = [nominal, *(np.empty_like(nominal) if own else nominal for own in moves)]
    axes[2] = axes[2] if moves[1] else axes[1]
    origins = [room(batch, count, 3)]
    origins.append(np.empty_like(origins[0]) if moves[1] else origins[0])
    ends: list[tuple[Array, Array]] = []  # of the frames, after their joints' motion
    rotation, origin = np.eye(3), np.zeros(3)
    for k in range(count):
        if k > 0:
            rotation, origin = ends[robot.parents[k - 1]]
            C = robot.origins[k - 1]
            if C[:3, 3].any():
                origin = origin + by_one(rotation, C[:3, 3:])[..., 0]
            if not np.array_equal(C[:3, :3], _UNTURNED):
                rotation = by_one(rotation, C[:3, :3])
        nominal[..., k, :, :] = rotation
        for stage, own in enumerate(moves):
            if k in own:
                shift, turn = own[k]
                origin, rotation = origin + rotate(rotation, shift), turned(rotation, turn)
            axes[stage + 1][..., k, :, :], origins[stage][..., k, :] = rotation, origin
        if 0 < k <= robot.dof:
            if robot.prismatic[k - 1]:
                origin = origin + rotate(rotation, robot.axes[k - 1] * q[:, k - 1, None])
            else:
                rotation = turned(rotation, so3_about(joints[k - 1], q[:, k - 1]))
        moved[..., k, :, :] = rotation
        ends.append((rotation, origin))
    return Frames(
        DisplacedFrames(first, axes[0], axes[1], origins[0]),
        DisplacedFrames(second, axes[1], axes[2], origins[1]),
        moved,
    )


def _moves(xi: Array) -> dict[int, tuple[Array, Array]]:
    """Shift (..., m, 3) and rotation (..., m, 3, 3) of each frame that xi (..., m, F, 6) displaces."""
    at = np.flatnonzero(xi.any(axis=(*range(xi.ndim - 2), -1)))
    own = np.moveaxis(xi[..., at, :], -2, 0)
    shifts, turns = own[..., :3], so3_exp(own[..., 3:])
    return {k: (shifts[i], turns[i]) for i, k in enumerate(at.tolist())}


def tip_points(
    robot: Robot,
    q: Array,
    points: Array,
    corrections: Array | None = None,
    frames: IntArray | None = None,
) -> Array:
    """Points (k, 3) of tip frames in base axes at joint values (m, n), shape (m, k, 3), m.

    corrections : as for :func:`forward`
    frames : ndarray of int, shape (k,), of the tips; that of ``robot.tip`` without
    """
    own, placed = robot.on_tip(1) if frames is None else frames, forward(robot, q, corrections)
    return rotate(placed.R[:, own], points) + placed.o[:, own]


def point_slopes(robot: Robot, frames: Frames, points: Array, frame: int = -1) -> Array:
    """How points (m, 3), m, that ride on a tip move with the joints, (m, 3, n), m a rad or m.

    frame : of the tip; that of ``robot.tip`` without
    """
    own = slice(1, robot.dof + 1)
    axes = rotate(frames.R[:, own], robot.axes)
    turning = cross(axes, points[:, None] - frames.o[:, own])
    moved = np.where(robot.prismatic[:, None], axes, turning) * robot.moving(frame)[:, None]
    return np.swapaxes(moved, -1, -2)


def link_origins(robot: Robot, frames: Frames, q: Array) -> Array:
    """Origins of the frames that carry the links, shape (..., m, F, 3): prismatic travel in."""
    if not robot.prismatic.any():
        return frames.o
    travel = np.zeros((len(q), robot.frame_count, 3))
    travel[:, 1 : robot.dof + 1] = robot.prismatic[:, None] * robot.axes * q[:, :, None]
    return frames.o + rotate(frames.R, travel)


def spatial_columns(stage: DisplacedFrames, frame: int, basis: Array) -> Array:
    """Velocity fields of the arm beyond a frame, for each column of displacement there.

    A displacement ``basis @ d`` of the frame moves a point x beyond it by ``A + phi x x``.

    basis : ndarray, shape (..., m or 1, 6, p), d xi / d parameter
    Returns ndarray, shape (..., m, 6, p): (A, phi) in base axes.
    """
    turn = stage.R[..., frame, :, :]
    if stage.xi[..., frame, 3:].any():
        turn = turned(turn, so3_right_jacobian(stage.xi[..., frame, 3:]))
    phi = turned(turn, basis[..., 3:, :])
    slide = turned(stage.R_before[..., frame, :, :], basis[..., :3, :])
    out = room(phi.shape[:-2], 6, phi.shape[-1])
    out[..., 3:, :] = phi
    moved = cross(np.swapaxes(phi, -1, -2), stage.o[..., frame, None, :])
    out[..., :3, :] = slide - np.swapaxes(moved, -1, -2)
    return out


def point_levers(points: Array) -> Array:
    """``A + phi x point`` as a matrix on (A, phi), shape (..., 3, 6), of points (..., 3)."""
    out = np.zeros((*points.shape, 6))
    out[..., :3] = np.eye(3)
    out[..., 3:] = -skew(points)
    return out
