"""A day's arm and readings in plain NumPy: its forward kinematics share nothing with `calib`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from studies.research.benchmarks.placement import placement
from studies.research.withheld.robots import Arm

SIGMA = 15e-6  # m, of one coordinate of the instrument
READ, HELD = 40, 200  # poses
SCATTER = (
    20e-6,
    20e-6,
)  # m and rad, of one coordinate of an ordinary arm's tip, anew at each approach
_LENGTHS, _ANGLES = (0.3e-3, 1e-3), (0.2e-3, 1e-3)  # m, rad: deviations of one arm's usual errors
_GUESS = 2e-3  # m, by which a coordinate of a marker is guessed wrongly

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Setting:
    """times : size of the errors, 1 usual; markers : how many; scatters : whether the arm does."""

    times: float
    markers: int
    scatters: bool


@dataclass(frozen=True, eq=False)
class Day:
    """One arm and what was read of it.

    constants : ndarray, shape (n + 1, 6), m and rad, errors of the segments that end at joints and tip
    markers, guesses : ndarray, shape (M, 3), m, true and as the cell has them
    R, p : placement of the base in the instrument's frame
    q, held : ndarray, shape (40, n) and (200, n), rad or m; read : ndarray, shape (40, M, 3), m
    """

    arm: Arm
    constants: Array
    markers: Array
    guesses: Array
    R: Array
    p: Array
    q: Array
    held: Array
    read: Array

    def points(self, q: Array) -> Array:
        """Where the markers stand at joints (N, n), shape (N, M, 3), m, in the instrument's frame."""
        return _placed(*tips(self.arm, self.constants, q), self.markers, self.R, self.p)


def tips(arm: Arm, constants: Array, q: Array) -> tuple[Array, Array]:
    """Axes (N, 3, 3) and origins (N, 3), m, of the tip in base axes.

    constants : ndarray, shape (n + 1, 6), of each segment a shift and then a turn at its end
    """
    R, p = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    segments = [*((j.xyz, j.rpy) for j in arm.joints), (arm.tip_xyz, arm.tip_rpy)]
    for k, (xyz, rpy) in enumerate(segments):
        p, R = p + R @ np.array(xyz), R @ Rotation.from_euler("xyz", rpy).as_matrix()
        p = p + R @ constants[k, :3]
        R = R @ Rotation.from_rotvec(constants[k, 3:]).as_matrix()
        if k == arm.dof:
            break
        joint, moved = arm.joints[k], q[:, k, None] * arm.axes[k]
        if joint.slides:
            p = p + (R @ moved[..., None])[..., 0]
        else:
            R = R @ Rotation.from_rotvec(moved).as_matrix()
    return R, p


def draw_day(arm: Arm, setting: Setting, index: int, seed: int) -> Day:
    """One day; of one index the errors of all sizes are the same but for their size."""
    rng = np.random.default_rng([seed, index, arm.dof])
    sizes = [np.exp(rng.uniform(*np.log(ends))) for ends in (_LENGTHS, _ANGLES)]
    constants = setting.times * rng.normal(size=(arm.dof + 1, 6)) * np.repeat(sizes, 3)
    guesses = _guesses(rng, arm, setting.markers)
    markers = guesses + rng.normal(size=guesses.shape) * _GUESS
    placed = placement(rng)
    low, high = arm.limits.T
    q, held = (low + rng.random((count, arm.dof)) * (high - low) for count in (READ, HELD))
    R, p = tips(arm, constants, q)
    if setting.scatters:
        shift, turn = (rng.normal(size=(READ, 3)) * size for size in SCATTER)
        p = p + (R @ shift[..., None])[..., 0]
        R = R @ Rotation.from_rotvec(turn).as_matrix()
    stood = _placed(R, p, markers, *placed)
    read = stood + rng.normal(size=stood.shape) * SIGMA
    return Day(arm, constants, markers, guesses, *placed, q, held, read)


def _placed(R: Array, p: Array, markers: Array, R_in: Array, p_in: Array) -> Array:
    points = np.einsum("nij,mj->nmi", R, markers) + p[:, None]
    return np.asarray(points @ R_in.T + p_in)


def _guesses(rng: np.random.Generator, arm: Arm, count: int) -> Array:
    """Reflectors about the tool at uneven heights, m, as the cell shows them."""
    turn = rng.uniform(0, 2 * np.pi) + np.arange(count) * 2 * np.pi / count
    across = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(0.4, 0.7)
    along = rng.uniform(0.5, 1.1, (count, 1))
    return np.asarray(np.round(np.hstack([across, along]) * arm.tool, 4))
