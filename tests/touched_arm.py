"""A small arm of plain numpy whose points touch and are measured, beside cells of that arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import calib
from calib import Cell, Measurements
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.cell import Repeatability
from calib.instruments import Instrument
from calib.poses import poses_at
from tests.helpers import cell_of, random_robot
from tests.plain_arm import tips

MARKERS = np.array([[0.10, 0.02, -0.05], [-0.04, 0.12, 0.03]])
OFFSETS = ("j2", "j3", "j4")
OFF = f"joint_offset:{','.join(OFFSETS)}"
TRUE = np.array([4e-4, -7e-4, 5e-4])  # rad, of the joints of OFFSETS
SCALE = 1.002
SITES = ("a", "b", "c", "d")


def arm() -> Robot:
    return random_robot(np.random.default_rng(11), 4)


def parallel(robot: Robot) -> Robot:
    """The robot with all axes parallel: it turns in a plane, and slides across."""
    origins = robot.origins.copy()
    origins[:, :3, :3] = np.eye(3)
    return replace(robot, axes=np.tile([0.0, 0.0, 1.0], (robot.dof, 1)), origins=origins)


def drawn(count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (count, 4))


def points_of(robot: Robot, q: Array, off: Sequence[float] = (), markers: Array = MARKERS) -> Array:
    """Markers in base axes (m, M, 3), the joints of the first OFFSETS off by so much."""
    error = np.zeros(robot.dof)
    error[1 : 1 + len(off)] = off
    T = tips(robot, q + error)
    return np.asarray(markers @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])


def slopes(function: Callable[[Array], Array], theta: Array) -> Array:
    """Derivatives (N, p) by central differences."""
    ends = [function(theta + h) - function(theta - h) for h in 1e-6 * np.eye(len(theta))]
    return np.column_stack([end.ravel() / 2e-6 for end in ends])


def cell_with(*instruments: Instrument, effects: Sequence[str] = ("base", OFF)) -> Cell:
    cell = cell_of(arm(), MARKERS, effects)
    return replace(cell, instruments=instruments, repeatability=Repeatability(0.0, 0.0))


def measured(q: Array, readings: Array, seen: Array | None = None, **given: object) -> Measurements:
    shape = readings.shape[:2]
    seen = np.ones(shape, dtype=bool) if seen is None else seen
    poses = poses_at(q, **given)
    return Measurements(poses, readings * seen[..., None], seen, np.full(shape, np.nan))


def positions(found: calib.Identification, *names: str) -> list[int]:
    """Of the parameters with these names among the values."""
    ids = [p.id for p in found.model.parameters]
    return [ids.index(name) for name in names]


def length(v: Array) -> Array:
    return np.asarray(np.sqrt((v**2).sum(axis=-1)))


def followed(q: Array, of: Callable[[Array], Array]) -> Array:
    """How joints (m, n) follow what they make (m, r), shape (m, n, r)."""
    ends = [of(q + h) - of(q - h) for h in 1e-6 * np.eye(q.shape[1])]
    return np.linalg.pinv(np.stack(ends, axis=-1) / 2e-6, rcond=1e-3)


def led_to(
    q: Array, of: Callable[[Array], Array], goal: Array | float = 0.0
) -> tuple[Array, Array]:
    """Joints (m, n) that make what they should, (m, r), by Newton's steps; whether they do."""
    for _ in range(15):
        step = (followed(q, of) @ (goal - of(q))[..., None])[..., 0]
        q = q + step * np.minimum(1.0, 0.4 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
    return q, np.abs(goal - of(q)).max(axis=1) < 1e-9


def contacts_of_a_larger_arm(robot: Robot) -> tuple[Measurements, Array]:
    """Contacts of an arm whose every length is larger than in its model, and its four sockets."""
    true = replace(robot, origins=robot.origins.copy())
    true.origins[:, :3, 3] *= SCALE

    def ball(q: Array) -> Array:
        return points_of(true, q, markers=SCALE * MARKERS[:1])[:, 0]

    rng = np.random.default_rng(6)
    centres = ball(rng.uniform(-2.0, 2.0, (4, 6)))
    site = np.arange(120) % 4
    q, there = led_to(rng.uniform(-2.0, 2.0, (120, 6)), ball, centres[site])
    readings = np.zeros((int(there.sum()), 1, 3))
    return measured(q[there], readings, site=np.array(SITES)[site[there]]), centres
