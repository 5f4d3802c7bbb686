"""From the names of a result to the frames and variables they stand for: ``A3``, ``q:A3``, ``load``."""

from __future__ import annotations

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.variables import last_moves
from calib.effects.drive import along_axis
from calib.effects.protocol import PoseEffect, State, TwistEffect, displaced

_BESIDE = 1e-6  # share of a squared displacement that counts as none
_ARM = 0.3  # m, at which a rotation counts as much as a shift


def frame_of(where: str, robot: Robot) -> int | None:
    """Number of the frame that is displaced at a place, None where it is no single one."""
    if where in robot.joints:
        return robot.joints.index(where) + 1
    return {"base": 0, "tool": robot.tip_frame}.get(where)


def displacement_of(candidate: Candidate, values: Array, frame: int, state: State) -> Array | None:
    """Displacement of a frame by an effect at its values (p,), shape (m, 6), SI.

    None where the effect acts otherwise: a load, a reading.
    """
    effect = candidate.effect
    if not isinstance(effect, TwistEffect):
        return None
    if isinstance(effect, PoseEffect):
        moved = effect.displacements(state.poses, values)
    else:
        moved = displaced(effect.twists(state, values), values)
    own = [xi for at, xi in moved if at == frame]
    return np.sum([np.broadcast_to(b, (len(state.poses), 6)) for b in own], axis=0) if own else None


def directions_of(where: str, moved: Array | None, frame: int, robot: Robot, state: State) -> Array:
    """Directions in which a place is off, shape (6, c), orthonormal, in the axes of its frame.

    A joint is off along its axis, or across it where it is displaced so. The first direction across is
    that about which the moment varies most.
    moved : ndarray, shape (m, 6), by which the frame is displaced, if that is known
    """
    if where not in robot.joints:
        return np.eye(6)
    axis = along_axis(robot, robot.joints.index(where))
    if moved is None or axis[:3].any() or _along(moved, axis):
        return axis[:, None]
    across = np.eye(3) - np.outer(axis[3:], axis[3:])
    moments = state.wrench.local[:, frame, 3:] @ across
    # A little of the frame's own axes decides where no moment varies.
    _, _, Vt = np.linalg.svd(np.concatenate([moments - moments.mean(axis=0), 1e-9 * across]))
    tilts = np.column_stack([Vt[0], np.cross(axis[3:], Vt[0])])
    return np.concatenate([np.zeros((3, 2)), tilts])


def _along(moved: Array, axis: Array) -> bool:
    beside = moved - np.outer(moved @ axis, axis)
    return float((beside**2).sum()) <= _BESIDE * float((moved**2).sum())


def variable_of(
    depends_on: str, load: Array, frame: int, robot: Robot, state: State
) -> Array | None:
    """Value at each pose of what an error depends on, shape (m,), SI; None where it is no number.

    load : ndarray, shape (6,), component of the wrench that stands for the load
    """
    poses = state.poses
    kind, _, joint = depends_on.partition(":")
    if kind == "load":
        return np.asarray(state.wrench.local[:, frame] @ load)
    if joint not in robot.joints:
        return {
            "time": poses.clock if poses.clocked else None,
            "temperature": poses.temperature,
        }.get(kind)
    k = robot.joints.index(joint)
    if kind == "q":
        return poses.q[:, k]
    if kind == "motion":
        return None if poses.motion is None else last_moves(poses)[:, k]
    return None if poses.approach is None or kind != "approach" else poses.approach[:, k]


def load_of(moved: Array | None, directions: Array, frame: int, state: State) -> Array:
    """Component of the wrench at a frame over which its error is drawn, shape (6,), a unit vector.

    For a joint that along its first direction; for base and tool the one that the displacement follows
    best, or that varies most where no displacement is known.
    """
    if directions.shape[1] < len(directions):
        return directions[:, 0]
    wrench = state.wrench.local[:, frame] - state.wrench.local[:, frame].mean(axis=0)
    size = np.maximum(np.linalg.norm(wrench, axis=0), 1e-12)
    if moved is None:
        return np.asarray(np.eye(6)[int(np.argmax(size))])
    lengths = moved * np.where(np.arange(6) < 3, 1.0, _ARM)
    followed = np.linalg.norm((wrench / size).T @ lengths, axis=1)
    return np.asarray(np.eye(6)[int(np.argmax(followed))])
