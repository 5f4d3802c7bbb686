"""Synthetic measurements: the full nonlinear model, equilibrium iterated, with noise."""

from __future__ import annotations

import numpy as np

from calib.model import Model
from calib.noise import Noise
from calib.poses import Measurements, Poses
from calib.se3 import Array, rotate


def simulate(
    model: Model,
    values: Array,
    poses: Poses,
    noise: Noise,
    rng: np.random.Generator,
    instrument: Array | None = None,
) -> Measurements:
    """Readings of all markers at the poses, with noise along and across the beams.

    values : ndarray, shape (p,), SI, the truth
    instrument : ndarray, shape (3,), m, base frame: where the beams start, else the origin of the
        readings
    """
    points = model.predict(values, poses)
    points = points + draw(noise, beams(model, values, poses, points, instrument), rng)
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
