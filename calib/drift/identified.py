"""The drift of a session beside what its identification knows of instrument and arm.

How the arm returns is judged beside a steady motion of each station, by restricted likelihood: a drift
would else count as the arm's, and hide behind it.
"""

from __future__ import annotations

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array
from calib.cell import Cell
from calib.drift.check import Drift, drift_of
from calib.identification import Identification
from calib.identification.whitening import whitening
from calib.model import Model
from calib.observations import Points
from calib.observations.rigid import rigid_motions
from calib.poses import Measurements
from calib.scatter import Variances, scatter_of, unnoticed
from calib.scatter.search import problem_of, searched


def drift_in(cell: Cell, found: Identification, data: Measurements) -> Drift | None:
    """What repeated readings of the tracker say; None without a tracker, or where none was repeated.

    data : all that was read, the poses held out included
    """
    tracked = found.model.tracked(data)
    if tracked is None:
        return None
    model, own = tracked
    weights = whitening(cell, model, found.values, own)
    if drift_of(own, weights) is None:
        return None
    fitted = found.model.tracked(found.fit.data.take(~found.fit.outlier)) or tracked
    arm = scatter_of(model, found.values, own.poses, _arm(cell, found, *fitted))
    return drift_of(own, weights, arm)


def _arm(cell: Cell, found: Identification, model: Model, own: Measurements) -> Variances:
    """How the arm returns by the poses fitted: as found, else on average over what is likely."""
    values, span = found.values, np.eye(len(found.values))[:, found.std > 0.0]
    points = Points(model, own, whitening(cell, model, values, own))
    still = scatter_of(model, values, own.poses, Variances.none(model.robot.dof))
    r, J = points.linearise(values)
    steady = points.rows(_steady(own))
    off, by_known = model.beside(values)
    free = np.zeros((len(off), steady.shape[-1]))
    problem, start, may = problem_of(
        still,
        points.rows(still.levers),
        r,
        np.concatenate([J @ span, steady], axis=-1),
        np.column_stack([by_known @ span, free, off]),
        cell.repeatability,
    )
    arm = searched(problem, start, may, still).variances
    hidden = None
    if not arm.any and cell.repeatability is None:
        hidden = unnoticed(still, problem, usual_repeatability(model.robot.reach), 1.0)
    if hidden is not None:
        return hidden.variances
    if still.has_approaches:
        return arm
    return Variances(arm.scale, arm.approach + arm.configuration, arm.configuration)


def _steady(data: Measurements) -> Array:
    """How the points follow a steady motion of each station, shape (m, M, 3, 6 stations)."""
    poses, seen = data.poses, data.seen
    clock = poses.clock - poses.clock.mean()
    moved = rigid_motions(data.points - data.points[seen].mean(axis=0))
    moved = moved.reshape(*data.points.shape, 6) * seen[..., None, None]
    moved = moved * (clock / (np.abs(clock).max() or 1.0))[:, None, None, None]
    return np.concatenate(
        [moved * (poses.station == s)[:, None, None, None] for s in np.unique(poses.station)],
        axis=-1,
    )
