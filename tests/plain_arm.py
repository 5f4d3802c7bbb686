"""Forward kinematics in a few lines of their own: nothing here knows how posecal composes frames."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array


def turn(axis: str, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    rows = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }
    T = np.eye(4)
    T[:3, :3] = rows[axis]
    return T


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def rotation(r: Array) -> Array:
    """About vectors (..., 3), by their length in rad: Rodrigues' formula."""
    angle = np.sqrt((r**2).sum(axis=-1))[..., None, None]
    x, y, z = np.moveaxis(r / np.where(angle == 0.0, 1.0, angle)[..., 0], -1, 0)
    K = np.zeros((*x.shape, 3, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -z, y, -x
    K -= np.swapaxes(K, -1, -2)
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K))


def frame(xi: Array) -> Array:
    """Places (m) and rotation vectors (rad), (..., 6), as (..., 4, 4)."""
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = rotation(xi[..., 3:]), xi[..., :3], 1.0
    return T


def tips(robot: Robot, q: Array) -> Array:
    """Nominal tips in base axes, link by link, shape (m, 4, 4)."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for k, values in enumerate(np.transpose(q)):
        slides = robot.prismatic[k]
        moved = np.concatenate([robot.axes[k] * slides, robot.axes[k] * (not slides)])
        T = T @ robot.origins[k] @ frame(values[:, None] * moved)
    return np.asarray(T @ robot.origins[-1])


def looking(target: Array, at: Array) -> Array:
    """A camera's frame (4, 4) in base axes: at a place, with its axis towards another."""
    z = (target - at) / np.linalg.norm(target - at)
    x = np.cross(z, [0.1, 0.2, 1.0])
    x = x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([x, np.cross(z, x), z]), at
    return T


def rows_of(text: str) -> list[dict[str, float | str]]:
    """Rows of a DH table in rad and m, whatever its units."""
    found: list[dict[str, float | str]] = []
    scale = {"deg": math.pi / 180, "rad": 1.0, "mm": 1e-3, "m": 1.0}
    for line in csv.DictReader(io.StringIO(text)):
        row: dict[str, float | str] = {"kind": "revolute", "beta": 0.0}
        for key, value in line.items():
            name, _, unit = key.rpartition("_")
            row[name or key] = float(value) * scale[unit] if name else value
        found.append(row)
    return found


def dh_pose(text: str, convention: str, q: Array) -> Array:
    """T of a table's last frame in its first, joint values in rad or m."""
    T = np.eye(4)
    for row, value in zip(rows_of(text), q, strict=True):
        slides = row["kind"] == "prismatic"
        theta = row["theta"] + (0.0 if slides else value)  # type: ignore[operator]
        d = row["d"] + (value if slides else 0.0)  # type: ignore[operator]
        joint = turn("z", theta) @ shift(z=d)
        link = shift(x=row["a"]) @ turn("x", row["alpha"]) @ turn("y", row["beta"])  # type: ignore[arg-type]
        T = T @ joint @ link if convention == "classic" else T @ link @ joint
    return T


def rpy_pose(origins: list[list[float]], q: Array) -> Array:
    """Joints about z behind origins ``x y z roll pitch yaw``; origins beyond the joints are fixed."""
    T = np.eye(4)
    for k, (x, y, z, roll, pitch, yaw) in enumerate(origins):
        T = T @ shift(x, y, z) @ turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
        T = T @ turn("z", q[k]) if k < len(q) else T
    return T
