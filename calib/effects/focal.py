"""A focal length that is not what the cell states: what its constant error and its drifts share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from calib.arrays import Array
from calib.effects.camera import CameraEffect
from calib.effects.context import Context
from calib.instruments import Camera
from calib.instruments.lens import CENTER
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class FocalEffect(CameraEffect):
    """The image grows about the centre by a share in proportion to what is known of the pose.

    centre : ndarray, shape (2,), px, as the cell gives it
    """

    centre: Array

    @classmethod
    def made(cls, context: Context, where: str, camera: Camera) -> Self:
        return cls(where, camera.lens.values[CENTER])

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """D share / d parameter, shape (m,)."""

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        share = self.shares(poses)[:, None, None]
        away, grown = points - self.centre, 1.0 + share * values[..., None, None, :]
        turn = grown[..., None] * np.eye(2)
        return self.centre + grown * away, turn, (share * away)[..., None]
