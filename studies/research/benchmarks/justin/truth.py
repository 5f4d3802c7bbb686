"""A true Justin in plain NumPy, which shares no code with the model: links off, drives that yield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from calib import Cell
from calib.arrays import Array, IntArray

_GRAVITY = np.array([0.0, 0.0, -9.80665])
_ROUNDS = 30  # of the equilibrium; each leaves a hundredth of the one before it
_LINK_M, _LINK_RAD = 3e-4, 5e-4
_SOFT = (5e-5, 3e-4)  # rad/(N m), as identified on the real one
FOCAL, CENTRE = 900.0, np.array([640.0, 480.0])
CAMERA = np.eye(4)
"""Of the camera in the head: it looks forward, along x of the chest, whose y points down."""
CAMERA[:3, :3] = Rotation.from_euler("y", 90.0, degrees=True).as_matrix()
CAMERA[:3, 3] = [0.06, -0.05, 0.0]


@dataclass(frozen=True, eq=False)
class Truth:
    """A tree of joints that turn, drawn about the nominal one of a cell.

    parents : of each frame after the base; steps : ndarray, shape (F - 1, 4, 4), from the parent, true
    axes, coms : ndarray, shape (n, 3); masses, compliances : ndarray, shape (n,); of joints and links
    markers : ndarray, shape (M, 3), m, in frames ``on``
    camera : ndarray, shape (4, 4), in frame ``head``, where there is one
    """

    parents: tuple[int, ...]
    steps: Array
    axes: Array
    masses: Array
    coms: Array
    compliances: Array
    driven: Array
    markers: Array
    on: IntArray
    head: int = 0
    camera: Array = field(default_factory=lambda: np.eye(4))

    @classmethod
    def drawn(cls, cell: Cell, rng: np.random.Generator) -> Truth:
        """Each link off by a few tenths, each drive as soft as those of the real arm."""
        robot = cell.robot
        count = len(robot.origins)
        steps = robot.origins @ _motion(
            _LINK_RAD * rng.normal(size=(count, 3)), _LINK_M * rng.normal(size=(count, 3))
        )
        soft = np.exp(rng.uniform(np.log(_SOFT[0]), np.log(_SOFT[1]), robot.dof))
        own = np.unique(cell.marker_frames)
        shift = dict(zip(own.tolist(), 2e-3 * rng.normal(size=(len(own), 3)), strict=True))
        moved = np.array([shift[frame] for frame in cell.marker_frames.tolist()])
        seats = [cell.marker_frames[own.start] for own in cell.seats.values()]
        return cls(
            tuple(robot.parents), steps, robot.axes, robot.masses, robot.coms, soft, _rod(robot.joints),
            cell.markers + moved, cell.marker_frames, int(seats[0]) if seats else 0,
            CAMERA @ _motion(_LINK_RAD * rng.normal(size=3), 2e-3 * rng.normal(size=3)),
        )  # fmt: skip

    def frames(self, q: Array) -> Array:
        """Every frame in base axes, shape (m, F, 4, 4); q (m, n), rad."""
        found = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
        for k, (parent, step) in enumerate(zip(self.parents, self.steps, strict=True)):
            turn = self.axes[k] * q[:, k, None] if k < len(self.axes) else np.zeros((len(q), 3))
            found.append(found[parent] @ step @ _motion(turn, np.zeros_like(turn)))
        return np.stack(found, axis=1)

    def torques(self, T: Array) -> Array:
        """Of gravity about each joint's axis, shape (m, n), N m, for frames (m, F, 4, 4)."""
        n = len(self.masses)
        own = T[:, 1 : n + 1]
        com = np.einsum("mkij,kj->mki", own[..., :3, :3], self.coms) + own[..., :3, 3]
        found = np.zeros(own.shape[:2])
        for link in range(n):
            joint = link
            while joint >= 0:  # down to the base, through all that bear it
                arm = com[:, link] - own[:, joint, :3, 3]
                axis = own[:, joint, :3, :3] @ self.axes[joint]
                pull = np.cross(arm, self.masses[link] * _GRAVITY)
                found[:, joint] += np.einsum("mi,mi->m", axis, pull)
                joint = self.parents[joint] - 1
        return found

    def at_rest(self, q: Array) -> Array:
        """Frames where the drives hold the links, which they carry there.

        By virtual work a drive feels the torques of all the joints that turn with it.
        """
        T = self.frames(q)
        for _ in range(_ROUNDS):
            yielded = self.compliances * (self.torques(T) @ self.driven)
            T = self.frames(q + yielded @ self.driven.T)
        return T

    def points(self, q: Array) -> Array:
        """All markers in base axes, shape (m, M, 3), m."""
        return self._placed(self.at_rest(q))

    def pixels(self, q: Array) -> Array:
        """All markers as the head's camera sees them, shape (m, M, 2), px."""
        T = self.at_rest(q)
        eye = np.linalg.inv(T[:, self.head] @ self.camera)
        seen = np.einsum("mij,mkj->mki", eye[:, :3, :3], self._placed(T)) + eye[:, None, :3, 3]
        return np.asarray(FOCAL * seen[..., :2] / seen[..., 2:] + CENTRE)

    def _placed(self, T: Array) -> Array:
        own = T[:, self.on]
        return np.asarray(
            np.einsum("mkij,kj->mki", own[..., :3, :3], self.markers) + own[..., :3, 3]
        )


def _rod(joints: Sequence[str]) -> Array:
    """By how much each joint turns for one of each drive: a rod turns t4 back by t2 and t3."""
    driven = np.eye(len(joints))
    driven[joints.index("t4")] = [-1.0 if j in ("t2", "t3") else 0.0 for j in joints]
    return driven


def _motion(turn: Array, shift: Array) -> Array:
    """Of rotation vectors (.., 3) and shifts (.., 3), shape (.., 4, 4)."""
    found = np.zeros((*turn.shape[:-1], 4, 4))
    found[..., :3, :3] = (
        Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(*turn.shape[:-1], 3, 3)
    )
    found[..., :3, 3], found[..., 3, 3] = shift, 1.0
    return found
