"""The lens that an identification found: by what was free of it, or by effects of the model."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.focal import FocalScale
from calib.effects.lens import LensEffect
from calib.identification.identification import Identification
from calib.instruments import Camera
from calib.instruments.lens import FOCAL


def lens_of(result: Identification, camera: Camera) -> tuple[Array, Array, Mask]:
    """Values (n,) of a camera's lens, their covariance (n, n), and which were asked for, (n,).

    In the order and the units of :class:`calib.instruments.lens.Lens`.
    """
    by = np.zeros((len(camera.lens.values), len(result.values)))
    for effect, part in zip(result.model.effects, result.model.slices, strict=True):
        if isinstance(effect, Base) and effect.of.name == camera.name:
            by[camera.free, np.arange(part.stop - len(camera.free), part.stop)] = 1.0
        elif isinstance(effect, LensEffect) and effect.changes(camera):
            by[effect.values, part] = np.eye(part.stop - part.start)
        elif isinstance(effect, FocalScale) and effect.changes(camera):
            by[FOCAL, part.start] = camera.lens.values[FOCAL]
    covariance = by @ result.covariance @ by.T
    return camera.lens.values + by @ result.values, covariance, np.asarray(by.any(axis=1))
