"""The criteria as an identified arm lets expect them, with intervals, where nothing was repeated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects.protocol import ElasticEffect
from calib.iso9283.formulas import of_scatter, repeatability_of
from calib.iso9283.measured import AXES, MarkerReadings, StaticCompliance
from calib.model.covariance import at_points_read
from calib.scatter import Variances, scatter_of
from calib.uncertainty.expanded import Interval, coverage_factor, lengths

_FORCE = 10.0  # N, to both sides: deflections are next to linear


@dataclass(frozen=True, eq=False)
class PredictedPose:
    """accuracy : of nominal commands; repeatability : None where nothing says how the arm returns."""

    name: str
    accuracy: Interval
    off: Array
    repeatability: Interval | None


@dataclass(frozen=True, eq=False)
class PredictedCriteria:
    """What is expected at each configuration; all along lines and axes of the base frame."""

    poses: tuple[PredictedPose, ...]
    compliance: tuple[StaticCompliance, ...]


def predicted(
    cell: Cell, session: MarkerReadings, where: IntArray, freedom: float
) -> PredictedCriteria:
    """The criteria at some readings of a table, each a configuration.

    where : ndarray of int, positions of the readings; freedom : degrees of freedom behind the result
    """
    if not len(where):
        return PredictedCriteria((), ())
    poses, estimate = session.poses.take(where), session.estimate
    model = at_points_read(session.model)
    _, J = model.jacobian(estimate.values, poses)
    roots, axes = np.linalg.eigh(estimate.covariance)
    half = axes * np.sqrt(np.maximum(roots, 0.0))
    off = session.predicted[where] - session.commanded[where]
    away = np.swapaxes(session.R[where], -1, -2) @ (J[:, session.marker] @ half)
    found = lengths(off, away)
    again = _repeatability(cell, session, where)
    return PredictedCriteria(
        tuple(
            PredictedPose(
                poses.names[i],
                Interval(float(np.linalg.norm(off[i])), float(found[i, 1]), float(found[i, 2])),
                off[i],
                None if again is None else of_scatter(repeatability_of(again[i]), freedom),
            )
            for i in range(len(poses))
        ),
        tuple(_compliance(session, where, half, freedom)),
    )


def _repeatability(cell: Cell, session: MarkerReadings, where: IntArray) -> Array | None:
    """Covariance (m, 3, 3) of the marker from approach to approach, m^2; None where unknown."""
    model, variances = session.model, session.estimate.variances
    if variances is None or not variances.approach.any():
        if cell.repeatability is None:
            return None
        variances = Variances.of_arm(model.robot.dof, cell.repeatability)
    poses = session.poses.take(where)
    found = scatter_of(model, session.estimate.values, poses, variances)
    levers = found.levers[:, session.marker, :3]
    return np.asarray((levers * variances.approach[found.kinds]) @ np.swapaxes(levers, -1, -2))


def _compliance(
    session: MarkerReadings, where: IntArray, half: Array, freedom: float
) -> Iterator[StaticCompliance]:
    """Along each axis of the base, of a force on the tip; nothing where the model is rigid."""
    model, values = session.model, session.estimate.values
    if not any(isinstance(effect, ElasticEffect) for effect in model.effects):
        return
    poses = session.poses.take(where)
    for k, axis in enumerate(AXES):
        pull = np.zeros(6)
        pull[k] = _FORCE
        ends = [
            model.jacobian(values, replace(poses, wrench=poses.wrench + sign * pull))
            for sign in (1.0, -1.0)
        ]
        (ahead, J_ahead), (back, J_back) = ends
        along = session.R[where][:, :, k]
        moved = (ahead - back)[:, session.marker] / (2.0 * _FORCE)
        slopes = (J_ahead - J_back)[:, session.marker] / (2.0 * _FORCE)
        value = (along * moved).sum(axis=-1)
        std = np.linalg.norm(np.einsum("mi,mip->mp", along, slopes) @ half, axis=-1)
        sure = float(coverage_factor(freedom)) * std
        for i, name in enumerate(poses.names):
            figure = Interval(*(float(v[i]) for v in (value, value - sure, value + sure)))
            yield StaticCompliance(name, axis, 0, figure)
