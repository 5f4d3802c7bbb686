"""A table of points in the base frame of a result: what is measured, commanded and predicted there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import fit_rigid, rotate, so3_log
from calib.arrays import Array, Mask
from calib.compensation.estimate import Estimate
from calib.errors import CalibError
from calib.identification.noise_level import believed_sigma
from calib.model import Model
from calib.observations import orientable
from calib.poses import Measurements, Poses


@dataclass(frozen=True, eq=False)
class Session:
    """Readings of one marker, and the turns of the tip where its markers tell them, in base axes.

    points, seen : ndarray, shapes (m, 3), m, and (m,), of the marker
    commanded, predicted : ndarray, shape (m, 3), m, of the nominal and of the identified arm
    turns : ndarray, shape (m, 3), rad, of the tip against the nominal one; NaN where none is told
    R : ndarray, shape (m, 3, 3), of the base in the frame of each station
    sigma : float, m, of one coordinate of the instrument as stated
    """

    marker: int
    model: Model
    estimate: Estimate
    poses: Poses
    points: Array
    seen: Mask
    commanded: Array
    predicted: Array
    turns: Array
    R: Array
    sigma: float


def session_of(estimate: Estimate, data: Measurements, marker: str | None) -> Session:
    """The table by what a result knows of base and markers; the first marker that is read, by default.

    Raises CalibError: no tracker reads points, or not that marker.
    """
    found = estimate.model.tracked(data)
    if found is None:
        raise CalibError(
            "the criteria of ISO 9283 are made of points; here no tracker (kind points) reads markers"
        )
    model, data = found
    shown = np.flatnonzero(np.any(data.seen, axis=0))
    read = [model.marker_names[k] for k in shown]
    if marker is not None and marker not in read:
        raise CalibError(f"no marker {marker!r} is read here; there are {', '.join(read)}")
    j = model.marker_names.index(read[0] if marker is None else marker)
    values, poses = estimate.values, data.poses
    R, p = model.placement(values, poses)
    inverse = np.swapaxes(R, -1, -2)
    points = rotate(inverse[:, None], data.readings[..., :3] - p[:, None])
    markers, nominal = model.marker_positions(values), forward(model.robot, poses.q)
    R_tip, o_tip = nominal.R[:, -1], nominal.o[:, -1]
    frames = model.state(values, poses).frames
    turns = np.full((len(poses), 3), np.nan)
    told = orientable(markers, data.seen)
    if told.any():
        T = fit_rigid(points[told], np.broadcast_to(markers, points[told].shape),
                      data.seen[told].astype(float))  # fmt: skip
        turns[told] = so3_log(T[:, :3, :3] @ np.swapaxes(R_tip[told], -1, -2))
    return Session(
        j, model, estimate, poses, points[:, j], data.seen[:, j], rotate(R_tip, markers[j]) + o_tip,
        model.tip_points(frames, values, poses)[:, j], turns, R, _sigma(model, values, data),
    )  # fmt: skip


def _sigma(model: Model, values: Array, data: Measurements) -> float:
    W = model.readout.whitening(values, data.poses, data.readings[..., :3], data.sigma)
    return believed_sigma(data, W * data.seen[..., None, None], model.readout.channels.lengths)
