"""Joint values at which the arm as identified stands in a wanted pose, its deflection included."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibError
from calib.kinematics import Frames
from calib.model import Model
from calib.poses import IntArray, Poses
from calib.robot import Robot
from calib.se3 import Array, cross, rotate, so3_log

_ROUNDS = 40
_SETTLED = 1e-12  # rad or m, largest step of a joint
_SMALLEST = 1e-3  # of the strongest direction: what is weaker is none
_SWINGS = (
    0.1,
    0.03,
    0.01,
)  # rad, or share of the reach: a first step's most, less where it went astray
_FARTHEST = 0.2  # the same of the whole way


@dataclass(frozen=True, eq=False)
class Reached:
    """Where the arm ends, m targets.

    q : ndarray, shape (m, n), rad or m
    R, o : ndarray, shapes (m, 3, 3) and (m, 3), m, tip frame in base axes
    held : ndarray of bool, shape (m, n), joints that stopped at a limit
    lost : ndarray of int, shape (m,), directions given up because the arm hardly moves along them
    settled : ndarray of bool, shape (m,)
    """

    q: Array
    R: Array
    o: Array
    held: NDArray[np.bool_]
    lost: IntArray
    settled: NDArray[np.bool_]

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All of it, target by target."""
        return self.q, self.R, self.o, self.held, self.lost, self.settled


def tip_of(model: Model, values: Array, poses: Poses) -> Frames:
    """Frames of the arm at rest under its loads. Raises CalibError where it finds no rest."""
    frames = model.state(values, poses).frames
    if not np.isfinite(frames.o).all():
        raise CalibError("the arm finds no equilibrium: its compliances are far too large")
    return frames


def reach(model: Model, values: Array, poses: Poses, R: Array, o: Array, point: Array) -> Reached:
    """Move every pose until its tip frame is at (R, o), by Newton steps on the arm at rest.

    R, o : ndarray, shapes (m, 3, 3) and (m, 3), m, wanted tip frame in base axes
    point : ndarray, shape (3,), m, tip frame: the point that is to be in place

    The arm's velocities are those of its displaced frames; how the deflection changes with a step
    is left to the next one. Position comes first and orientation takes what freedom is left (task
    priority, Nakamura, Hanafusa and Yoshikawa 1987), so that arms of fewer than six joints put the
    point in its place. Directions in which the joints would have to swing far are left alone, and a
    joint that would pass its limit stays there.

    Raises CalibError where the arm finds no equilibrium.
    """
    found = _newton(model, values, poses, R, o, point, _SWINGS[0])
    for swing in _SWINGS[1:]:
        again = np.flatnonzero(~found.settled | (_swing(model, found.q - poses.q) > _FARTHEST))
        if not len(again):
            break
        retried = _newton(model, values, poses.take(again), R[again], o[again], point, swing)
        for mine, theirs in zip(found.arrays, retried.arrays, strict=True):
            mine[again] = theirs
    return found


def _swing(model: Model, change: Array) -> Array:
    """Largest motion of a joint at each pose, shape (m,), rad, or its share of the reach."""
    unit = np.where(model.robot.prismatic, model.robot.reach, 1.0)
    return np.asarray(np.abs(change / unit).max(axis=1))


def _newton(
    model: Model, values: Array, poses: Poses, R: Array, o: Array, point: Array, swing: float
) -> Reached:
    robot, m = model.robot, len(poses)
    low = np.minimum(robot.limits[:, 0], poses.q)
    high = np.maximum(robot.limits[:, 1], poses.q)
    goal = o + rotate(R, point)
    q, held = poses.q, np.zeros((m, robot.dof), dtype=bool)
    ranks: tuple[IntArray, IntArray] | None = None
    for _ in range(_ROUNDS):
        frames = tip_of(model, values, replace(poses, q=q))
        R_tip, o_tip = frames.R[:, -1], frames.o[:, -1]
        there = o_tip + rotate(R_tip, point)
        turn = so3_log(R @ np.swapaxes(R_tip, -1, -2))
        slide, spin, unit = _velocities(robot, frames, there)
        free = ~held * unit
        step, ranks = _step(
            slide * free[:, None], spin * free[:, None], goal - there, turn, swing, ranks
        )
        wanted = q + step * free
        moved = np.clip(wanted, low, high)
        stopped = (moved != wanted) & ~held
        size, q = np.abs(moved - q).max(axis=1, initial=0.0), moved
        if stopped.any():
            held, ranks = held | stopped, None
        elif size.max(initial=0.0) < _SETTLED:
            break
    frames = tip_of(model, values, replace(poses, q=q))
    directions = np.minimum(6, robot.dof - held.sum(axis=1))
    lost = directions - (0 if ranks is None else ranks[0] + ranks[1])
    return Reached(
        q, frames.R[:, -1].copy(), frames.o[:, -1].copy(), held, lost, size < 1e3 * _SETTLED
    )


def _velocities(robot: Robot, frames: Frames, point: Array) -> tuple[Array, Array, Array]:
    """How a point (m, 3) and the tip's axes move with each joint, (m, 3, n), and the joints' units.

    A joint that slides counts in units of the reach, so that both kinds weigh alike.
    """
    axes = rotate(frames.R[:, 1:-1], robot.axes)
    turning = cross(axes, point[:, None] - frames.o[:, 1:-1])
    slides = robot.prismatic[:, None]
    slide, spin = np.where(slides, axes, turning), np.where(slides, 0.0, axes)
    unit = np.where(robot.prismatic, robot.reach, 1.0)
    return np.swapaxes(slide, -1, -2), np.swapaxes(spin, -1, -2), unit


def _step(
    slide: Array,
    spin: Array,
    shift: Array,
    turn: Array,
    swing: float,
    ranks: tuple[IntArray, IntArray] | None,
) -> tuple[Array, tuple[IntArray, IntArray]]:
    """Smallest joint step (m, n) that shifts the point, and of those the one that turns best.

    ranks : how many directions of each kind count, kept from one step to the next; None to judge them
    """
    known = (None, None) if ranks is None else ranks
    step, own, first = _solved(slide, shift, swing, known[0])
    rest = np.eye(slide.shape[-1]) - np.swapaxes(own, -1, -2) @ own
    more, _, second = _solved(spin @ rest, turn - rotate(spin, step), swing, known[1])
    return step + more, (first, second)


def _solved(
    J: Array, error: Array, swing: float, rank: IntArray | None
) -> tuple[Array, Array, IntArray]:
    """Least-squares step (m, n) in the directions that count, these (m, r, n), and their number.

    Directions are counted from the strongest to the first that would need more than the swing.
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    along = rotate(np.swapaxes(U, -1, -2), error)
    if rank is None:
        least = np.maximum(np.abs(along) / swing, _SMALLEST * s[:, :1] + 1e-300)
        rank = np.cumprod(s > least, axis=-1).sum(axis=-1)
    kept = np.arange(s.shape[-1]) < rank[:, None]
    own = Vt * kept[..., None]
    return rotate(np.swapaxes(own, -1, -2), along / np.where(kept, s, 1.0)), own, rank
