"""Errors common to all readings at readings that are still to come: considered, as in the budget.

Values follow them by ``S = N^-1 J' W J_b`` (:mod:`calib.uncertainty.considered`). ``J' W J_b`` adds up
over visits as information does; ``N^-1`` is that of the plan.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.instruments import Tracker
from calib.instruments.common_errors import CommonError
from calib.model import Model
from calib.poses import Measurements, Poses
from calib.uncertainty.considered import by_gravity, common_displacements
from doe.problem.linearisation import Linearisation, Rows, weighted


def moved_rows(at: Linearisation, data: Measurements, weights: Array, like: Rows) -> Rows:
    """How readings (m) follow one standard uncertainty of each component, whitened, (m, R, b).

    weights : whitening matrices of the readings, (m, C, r, r); like : Rows, of the same readings
    """
    moved = [own * e.std for _, e, own in common_displacements(at.model, at.values, data)]
    if not moved:
        return Rows(like.whitened[..., :0], like.mixing)
    rows = weighted(weights, np.concatenate(moved, axis=-1))
    scale = 1.0 if at.arm.any else at.arm.scale
    return Rows(rows / scale, like.mixing)


def at_targets(model: Model, counts: Model, values: Array, targets: Poses) -> Array:
    """How predictions themselves follow, (K, r, b), m, the mean over the points in it.

    model : that readings are of; counts : with the points at which the error counts
    """
    shape = counts.predict(values, targets).shape
    found = [np.zeros((*shape, 0))]
    for error in errors_of(model):
        columns = error.kind.columns
        if columns is None:
            found.append(by_gravity(counts, values, targets) * error.std)
        else:
            found.append(np.zeros((*shape, columns(np.ones((1, 3))).shape[-1])))
    moved = np.concatenate(found, axis=-1)
    K, points, r = shape
    return np.asarray(moved.reshape(K, points * r, moved.shape[-1]) / np.sqrt(points))


def errors_of(model: Model) -> tuple[CommonError, ...]:
    """The common errors of a model's instruments, in the order of :func:`moved_rows`."""
    blocks = model.readout.channels.blocks
    return tuple(e for i, _ in blocks if isinstance(i, Tracker) for e in i.common)


def follow(rows: Array, response: Array, predicted: Array) -> Array:
    """Squared error by common errors at each target, (K,), m^2.

    rows : ndarray, (K, r, p), of the targets; response : (p, b), of the values; predicted : (K, r, b)
    """
    return np.asarray(((rows @ response - predicted) ** 2).sum(axis=(1, 2)))
