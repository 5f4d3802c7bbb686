"""The arm at n configurations, and what a constraint is: a yes or no for each of them.

A new constraint is one file with one such class and a function that makes it from a cell, None where
it cannot act, and one entry in ``doe.constraints.constraints_of``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib.arm.kinematics import Frames, forward, link_origins
from calib.arm.robot import Capsule
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.errors import CalibError

BASE = 0
_PROBE = 500  # configurations


@dataclass(frozen=True, eq=False)
class PlacedCapsule:
    """One capsule at n configurations.

    body : int, number of the frame that carries it: 0 base, 1 .. dof the joints, the last the tool
    name : str, of the joint, ``base`` or ``tool``; numbered where a body has several
    start, end : ndarray, shape (n, 3), m, ends of the axis in base axes; radius : float, m
    reach : float, m, radius of the ball around the centre that holds the capsule
    """

    body: int
    name: str
    start: Array
    end: Array
    radius: float
    reach: float

    @property
    def moves(self) -> bool:
        """Whether it is carried by the arm."""
        return self.body != BASE

    @cached_property
    def centre(self) -> Array:
        """Middle of the axis, shape (n, 3), m."""
        return 0.5 * (self.start + self.end)


@dataclass(frozen=True, eq=False)
class Scene:
    """A cell at n configurations q, ndarray of shape (n, dof), rad or m; nominal model, no loads."""

    cell: Cell
    q: Array

    def __len__(self) -> int:
        return len(self.q)

    @cached_property
    def frames(self) -> Frames:
        """Frames of the arm, leading shape (n, F)."""
        return forward(self.cell.robot, self.q)

    @cached_property
    def origins(self) -> Array:
        """Origins of the frames that carry the links, shape (n, F, 3), m."""
        return link_origins(self.cell.robot, self.frames, self.q)

    @cached_property
    def markers(self) -> Array:
        """Marker points, shape (n, M, 3), m, base axes."""
        carried = zip(self.cell.marker_frames.tolist(), self.cell.markers, strict=True)
        return np.stack([self.placed(frame, point) for frame, point in carried], axis=1)

    @cached_property
    def capsules(self) -> tuple[PlacedCapsule, ...]:
        """Every capsule of the cell, from the base to the tool."""
        return tuple(
            PlacedCapsule(
                body,
                name,
                self.placed(body, own.start),
                self.placed(body, own.end),
                own.radius,
                0.5 * float(np.linalg.norm(np.subtract(own.end, own.start))) + own.radius,
            )
            for body, name, own in named_capsules(self.cell)
        )

    def placed(self, body: int, point: ArrayLike) -> Array:
        """A point (3,) of a body's frame in base axes, shape (n, 3), m."""
        point = np.asarray(point, dtype=float)
        if body == BASE:
            return np.broadcast_to(point, (len(self), 3))
        return turned(self.frames.R_link[:, body], point) + self.origins[:, body]


def scene_of(cell: Cell, q: Array) -> Scene:
    """A cell at joint values q, shape (n, dof), rad or m. Raises CalibError for another shape."""
    q = np.asarray(q, dtype=float)
    if q.ndim != 2 or q.shape[1] != cell.robot.dof:
        raise CalibError(f"joint values have shape {q.shape}, expected (n, {cell.robot.dof})")
    return Scene(cell, q)


def named_capsules(cell: Cell) -> Iterator[tuple[int, str, Capsule]]:
    """Body number, name and shape of every capsule, from the base to the tool."""
    last = cell.robot.tip_frame
    for body, carrier in (*enumerate(("base", *cell.robot.joints)), (last, "tool")):
        capsules = cell.shapes.capsules.get(carrier, ())
        for i, capsule in enumerate(capsules, 1):
            yield body, carrier if len(capsules) == 1 else f"{carrier} #{i}", capsule


def moving_capsules(cell: Cell) -> bool:
    """Whether the cell gives the arm itself a shape."""
    return any(body != BASE for body, _, _ in named_capsules(cell))


def probe_scene(cell: Cell) -> Scene:
    """The cell at configurations that stand for all within its limits; the same ones every time."""
    low, high = cell.robot.sample_limits().T
    q = np.random.default_rng(0).uniform(low, high, (_PROBE, len(low)))
    return scene_of(cell, cell.robot.tied(q))


def turned(R: Array, vector: Array) -> Array:
    """One vector (3,) under n rotations (n, 3, 3), shape (n, 3)."""
    # A single product with (9, 3) takes a fifth of the time of n products with (3,).
    return np.asarray(R.reshape(-1, 9) @ np.kron(np.eye(3), vector[:, None]))


class Constraint(ABC):
    """Something that forbids configurations.

    name : str, short and unique in a cell: the key under which removed configurations are counted
    """

    name: str

    @abstractmethod
    def allows(self, scene: Scene) -> Mask:
        """Whether each of the n configurations may be measured, shape (n,)."""


class Clearance(Constraint):
    """One that keeps shapes apart."""
