"""What causes do to the arm: the slots in which anything that moves a marker may write."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.research.withheld.robots import Arm, Array


@dataclass(frozen=True, eq=False)
class State:
    """The arm at rest under its loads, as MuJoCo gives it, N readings, frames 0 .. n + 1.

    R, o : ndarray, shapes (N, n + 2, 3, 3) and (N, n + 2, 3), frames before joint motion, base axes, m
    R_link : ndarray, shape (N, n + 2, 3, 3), after joint motion
    wrench : ndarray, shape (N, n + 2, 6), force and moment that each frame passes on, about its origin,
        in its own axes, N and N m
    torque : ndarray, shape (N, n), N m, or N at a prismatic joint
    points : ndarray, shape (N, M, 3), markers, base axes, m
    aimed : ndarray, shape (N, M, 3), the same in the instrument's frame
    readings : ndarray, shape (N, M, 3), what the instrument says of them
    """

    R: Array
    o: Array
    R_link: Array
    wrench: Array
    torque: Array
    points: Array
    aimed: Array
    readings: Array


@dataclass(frozen=True, eq=False)
class Action:
    """Displacements and loads at N readings; actions add up.

    joint : ndarray, shape (N, n), ``q_true = q_read + joint``, rad or m
    twist : ndarray, shape (N, n + 2, 6), displacement of each frame on the right, m and rad
    load : ndarray, shape (N, n + 2, 6), force and torque at the centre of mass of each body, base axes
    marker : ndarray, shape (N, M, 3), of the markers in the tip frame, m
    reading : ndarray, shape (N, M, 3), in the instrument's frame, m
    """

    joint: Array
    twist: Array
    load: Array
    marker: Array
    reading: Array

    @staticmethod
    def none(arm: Arm, count: int, markers: int) -> Action:
        """Nothing yet: arrays to write into."""
        frames = arm.dof + 2
        return Action(
            np.zeros((count, arm.dof)),
            np.zeros((count, frames, 6)),
            np.zeros((count, frames, 6)),
            np.zeros((count, markers, 3)),
            np.zeros((count, markers, 3)),
        )

    def add(self, other: Action, factor: Array) -> None:
        """Add another one, reading by reading times a factor, shape (N,)."""
        for mine, theirs in (
            (self.joint, other.joint),
            (self.twist, other.twist),
            (self.load, other.load),
            (self.marker, other.marker),
            (self.reading, other.reading),
        ):
            mine += theirs * factor.reshape(-1, *(1,) * (theirs.ndim - 1))


def frame_columns(state: State, frame: int) -> Array:
    """D points / d twist of a frame, shape (N, M, 3, 6), base axes: what follows it moves rigidly."""
    R, arm = state.R[:, None, frame], state.points - state.o[:, None, frame]
    columns = np.empty((*state.points.shape, 6))
    columns[..., :3] = R
    for c in range(3):
        columns[..., 3 + c] = np.cross(R[..., c], arm)
    return columns
