"""Synthetic measurements: the full nonlinear model, equilibrium iterated, with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arm.se3 import rotate, so3_exp
from calib.arrays import Array, IntArray, Mask
from calib.cell import Repeatability
from calib.instruments import Camera, Tracker
from calib.instruments.riding import taken
from calib.model import Model
from calib.noise import Noise, unwhitened
from calib.poses import Measurements, Poses
from calib.poses.moves import visits


def drawn_readings(
    model: Model,
    values: Array,
    poses: Poses,
    noise: Noise | None,
    rng: np.random.Generator,
    arm: Repeatability | None = None,
) -> Measurements:
    """Readings of all markers at the poses, with the noise of the instruments.

    values : ndarray, shape (p,), SI, the truth
    noise : of a tracker, in place of the model's, with beams from the origin of its readings; None for
        the model's own instruments
    arm : how the tip scatters from one approach to the next, None for not at all
    """
    if noise is not None:
        read = [
            replace(i, noise=noise, stands=None) if isinstance(i, Tracker) else i
            for i in model.instruments
        ]
        model = replace(model, instruments=tuple(read))
    exact = model.predict(values, poses)
    noisy = draw(whitening(model, values, poses, exact), rng)
    if arm is not None:
        frames = model.state(values, poses).frames
        points = model.tip_points(frames, values, poses)
        origins = model.under_markers(frames)[1]
        moved = approached(points, origins, visits(poses), arm, rng)
        moved = model.readout.channels.seats_kept(moved, points)
        exact = model.readings(values, poses, moved)
    readings = exact + noisy
    shape = readings.shape[:-1]
    return Measurements(poses, readings, np.ones(shape, dtype=bool), np.full(shape, np.nan))


def photographed(model: Model, values: Array, poses: Poses) -> Mask:
    """Whether each reading can be had, shape (m, C): by a camera, what is in the image and faces it."""
    points = model.tip_points(model.state(values, poses).frames, values, poses)
    channels = model.readout.channels
    found = np.ones((len(poses), len(channels)), dtype=bool)
    blocks = zip(model.readout.placed(model.instruments, values), channels.blocks, strict=True)
    for camera, (_, part) in blocks:
        if isinstance(camera, Camera):
            found[:, part] = camera.found(taken(camera, points))
    return found


def whitening(model: Model, values: Array, poses: Poses, readings: Array) -> Array:
    """Whitening matrices of readings (m, C, r) that have the usual noise, shape (m, C, r, r)."""
    stated = np.full(readings.shape[:-1], np.nan)
    return model.readout.whitening(values, poses, readings, stated)


def draw(W: Array, rng: np.random.Generator) -> Array:
    """Noise that matrices W (..., r, r) whiten, shape (..., r)."""
    return unwhitened(W, rng.standard_normal(W.shape[:-1]))


def approached(
    points: Array,
    origins: Array,
    approach: IntArray,
    arm: Repeatability,
    rng: np.random.Generator,
) -> Array:
    """Points with the tip shifted and turned anew at each approach, shape (..., m, M, 3), m.

    points : ndarray, shape (..., m, M, 3), m; leading axes are trials, each with draws of its own
    origins : ndarray, shape (m, M or 1, 3), m, of the tips; approach : ndarray of int, shape (m,)
    """
    _, group = np.unique(approach, return_inverse=True)
    drawn = rng.standard_normal((*points.shape[:-3], int(group.max()) + 1, 6))[..., group, :]
    turn, shift = so3_exp(arm.rotation * drawn[..., 3:]), arm.translation * drawn[..., :3]
    moved: Array = rotate(turn[..., None, :, :], points - origins) + origins + shift[..., None, :]
    return moved
