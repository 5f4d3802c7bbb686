"""Synthetic measurements: the full nonlinear model, equilibrium iterated, with noise."""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import rotate, so3_exp
from calib.arrays import Array, IntArray
from calib.cell import Repeatability
from calib.model import Model
from calib.noise import Noise
from calib.poses import Measurements, Poses
from calib.poses.visits import visits


def simulate(
    model: Model,
    values: Array,
    poses: Poses,
    noise: Noise,
    rng: np.random.Generator,
    instrument: Array | None = None,
    arm: Repeatability | None = None,
) -> Measurements:
    """Readings of all markers at the poses, with noise along and across the beams.

    values : ndarray, shape (p,), SI, the truth
    instrument : ndarray, shape (3,), m, base frame: where the beams start, else the origin of the
        readings
    arm : how the tip scatters from one approach to the next, None for not at all
    """
    exact = model.predict(values, poses)
    noisy = draw(noise, beams(model, values, poses, exact, instrument), rng)
    if arm is not None:
        exact = approached(exact, tip_origins(model, values, poses), visits(poses), arm, rng)
    points = exact + noisy
    shape = points.shape[:-1]
    return Measurements(poses, points, np.ones(shape, dtype=bool), np.full(shape, np.nan))


def beams(
    model: Model, values: Array, poses: Poses, points: Array, instrument: Array | None
) -> Array:
    """Vectors from the instrument to the points, shape (m, M, 3), m, station axes."""
    if instrument is None:
        return points
    R, p = model.placement(values, poses)
    return points - (rotate(R, instrument) + p)[:, None, :]


def draw(noise: Noise, along: Array, rng: np.random.Generator) -> Array:
    """Noise of points on beams ``along``, shape (..., 3), m."""
    W = noise.whitening(along, np.full(along.shape[:-1], np.nan))
    white = rng.standard_normal((*along.shape, 1))
    return np.asarray(np.linalg.solve(np.broadcast_to(W, (*along.shape, 3)), white)[..., 0])


def tip_origins(model: Model, values: Array, poses: Poses) -> Array:
    """Origins of the tip frame in the frames of the stations, shape (m, 3), m."""
    o = model.state(values, poses).frames.o[:, -1:]
    return model.readings(values, poses, o)[:, 0]


def approached(
    points: Array, origins: Array, approach: IntArray, arm: Repeatability, rng: np.random.Generator
) -> Array:
    """Points with the tip shifted and turned anew at each approach, shape (..., m, M, 3), m.

    points : ndarray, shape (..., m, M, 3), m; leading axes are trials, each with draws of its own
    origins : ndarray, shape (m, 3), m, of the tip; approach : ndarray of int, shape (m,)
    """
    _, group = np.unique(approach, return_inverse=True)
    drawn = rng.standard_normal((*points.shape[:-3], int(group.max()) + 1, 6))[..., group, :]
    turn, shift = so3_exp(arm.rotation * drawn[..., 3:]), arm.translation * drawn[..., :3]
    o = origins[:, None]
    moved: Array = rotate(turn[..., None, :, :], points - o) + o + shift[..., None, :]
    return moved
