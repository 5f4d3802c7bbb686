"""Arms of every kind, and how they are driven: sensibly, or so that little can be told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from studies.research.withheld.robots import HEAVY, LIGHT, RAIL, Arm, Array, Joint

KINDS = ("light", "heavy", "rail", "seven", "scara", "gantry", "random")
MOTIONS = (
    "free", "free", "narrow", "still", "level", "one", "two", "line",
)  # fmt: skip
_LENGTH = 0.35  # m, of a link


def draw_arm(rng: np.random.Generator) -> Arm:
    """An arm of one of the kinds."""
    kind = str(rng.choice(KINDS))
    known = {"light": LIGHT, "heavy": HEAVY, "rail": RAIL}
    if kind in known:
        return known[kind]
    slides: tuple[bool, ...]
    if kind == "scara":
        slides, axes = (False, False, True, False), np.tile([0.0, 0.0, 1.0], (4, 1))
    elif kind == "gantry":
        slides, axes = (True, True, True, False, False), np.eye(3)[[0, 1, 2, 2, 0]]
    else:
        count = 7 if kind == "seven" else int(rng.integers(1, 8))
        slides = tuple((rng.random(count) < (0.0 if kind == "seven" else 0.2)).tolist())
        axes = np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1.0, 1.0], (count, 1))
    straight = kind in ("scara", "gantry")
    joints = tuple(
        _joint(rng, f"j{k + 1}", axis, slide, straight)
        for k, (axis, slide) in enumerate(zip(axes, slides, strict=True))
    )
    return replace(LIGHT, name=kind, joints=joints, base="base", tip="tip", tool=0.1)


def _joint(rng: np.random.Generator, name: str, axis: Array, slides: bool, straight: bool) -> Joint:
    x, y, z = rng.uniform(-_LENGTH, _LENGTH, 3).round(3).tolist()
    rpy = (0.0, 0.0, 0.0) if straight else tuple(rng.choice([0.0, np.pi / 2.0, 0.3], 3).tolist())
    high = 0.6 if slides else 2.5
    ax, ay, az = axis.tolist()
    mass = float(rng.uniform(0.5, 20.0))
    return Joint(
        name, (x, y, z), (ax, ay, az), -high, high, mass, (0.1, 0.0, 0.0), 1e-5, rpy, slides
    )


def reach(arm: Arm) -> float:
    """Length of the stretched arm, m."""
    steps = [np.linalg.norm(j.xyz) + (j.slides and max(-j.low, j.high)) for j in arm.joints]
    return float(np.sum(steps) + np.linalg.norm(arm.tip_xyz))


def draw_joints(rng: np.random.Generator, arm: Arm, motion: str, count: int) -> Array:
    """Joints at each pose, shape (count, n), rad or m."""
    low, high = arm.limits.T
    free = low + rng.random((count, arm.dof)) * (high - low)
    middle = low + rng.uniform(0.2, 0.8, arm.dof) * (high - low)
    if motion == "narrow":
        return np.asarray(middle + (free - middle) * 10.0 ** rng.uniform(-4.0, -1.0))
    if motion == "one":
        own = int(rng.integers(arm.dof))
        return np.asarray(np.where(np.arange(arm.dof) == own, free, middle))
    if motion == "two":
        return np.asarray(free[rng.integers(0, min(2, count), count)])
    if motion == "line":
        return np.asarray(
            middle + np.linspace(-0.3, 0.3, count)[:, None] * rng.normal(size=arm.dof)
        )
    if motion == "still":
        return np.asarray(np.tile(middle, (count, 1)))
    if motion == "level":
        return _level(arm, free, middle)
    return np.asarray(free)


def _level(arm: Arm, free: Array, middle: Array) -> Array:
    """The flange does not turn: what slides moves, and of parallel neighbours two against the third."""
    q = np.where(arm.slides, free, middle)
    for k in range(arm.dof - 2):
        three = arm.joints[k : k + 3]
        flat = not any(j.slides for j in three) and not any(any(j.rpy) for j in three[1:])
        if flat and np.ptp(arm.axes[k : k + 3], axis=0).max() == 0.0:
            q[:, k : k + 2] = middle[k : k + 2] + 0.3 * (free - middle)[:, k : k + 2]
            q[:, k + 2] = middle[k + 2] - (q[:, k : k + 2] - middle[k : k + 2]).sum(axis=1)
            break
    return np.asarray(q)


def posed(arm: Arm, q: Array, errors: Array) -> tuple[Array, Array]:
    """The tip in base axes, (m, 3, 3) and (m, 3), m.

    errors : ndarray, shape (n + 2, 6), m and rad: displacement of each frame in its own axes
    """
    R, p = _moved(np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3)), errors[0])
    for k, joint in enumerate(arm.joints):
        p = p + R @ np.array(joint.xyz)
        R = R @ Rotation.from_euler("xyz", joint.rpy).as_matrix()
        R, p = _moved(R, p, errors[k + 1])
        axis = np.array(joint.axis)
        if joint.slides:
            p = p + (R @ axis) * q[:, k, None]
        else:
            R = R @ Rotation.from_rotvec(q[:, k, None] * axis).as_matrix()
    p, R = p + R @ np.array(arm.tip_xyz), R @ Rotation.from_euler("xyz", arm.tip_rpy).as_matrix()
    return _moved(R, p, errors[-1])


def _moved(R: Array, p: Array, error: Array) -> tuple[Array, Array]:
    return R @ Rotation.from_rotvec(error[3:]).as_matrix(), p + R @ error[:3]


def approached(q: Array) -> NDArray[np.int_]:
    """Sign of the last motion of each joint, shape (m, n)."""
    return np.sign(np.diff(q, axis=0, prepend=q[:1])).astype(int)
