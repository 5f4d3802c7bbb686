"""Where a model is linearised before anything is known of the robot."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.model import Model
from calib.poses import Poses

_SOFTEST_M = 1e-3  # what an assumed compliance moves the markers by at most


def nominal(model: Model, poses: Poses) -> Array:
    """The nominal model, shape (p,), SI; as soft as usual where an error of load is to be seen.

    Weights, springs and payloads move the markers through compliances only.
    """
    if len(model.where(LoadEffect)):
        return soft(model, poses)
    return model.initial


def soft(model: Model, poses: Poses) -> Array:
    """Nominal, but elastic ones of usual size, or of what moves the markers a millimetre, (p,), SI."""
    values = model.initial
    _, J = model.jacobian(values, poses)
    moved = np.linalg.norm(J, axis=-2).max(axis=(0, 1))
    sizes = np.minimum(model.sizes, _SOFTEST_M / np.maximum(moved, 1e-300))
    elastic = model.where(ElasticEffect)
    values[elastic] = sizes[elastic]
    return values
