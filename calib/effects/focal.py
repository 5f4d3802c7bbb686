"""A focal length that is not what the cell states: what its constant error and its drifts share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.protocol import Effect
from calib.effects.readings import ReadingEffect
from calib.instruments import Camera, Instrument
from calib.instruments.lens import CENTER
from calib.poses import Poses

_CAMERA = "camera:"
_LENS = 10.0  # odds: of an arm and a camera the camera is looked at first


@dataclass(frozen=True, eq=False)
class FocalEffect(ReadingEffect):
    """The image grows about the centre by a share in proportion to what is known of the pose.

    centre : ndarray, shape (2,), px, as the cell gives it
    """

    centre: Array
    of: ClassVar[str] = "camera"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(_CAMERA + camera.name for camera in context.instruments if cls._acts(camera))

    @classmethod
    def _acts(cls, instrument: Instrument) -> bool:
        return isinstance(instrument, Camera)

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        cameras = (i for i in context.instruments if isinstance(i, Camera))
        camera = next(i for i in cameras if _CAMERA + i.name == where)
        return cls._of(context, where, camera.lens.values[CENTER])

    @classmethod
    def _of(cls, context: Context, where: str, centre: Array) -> Self:
        return cls(where, centre)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(odds=_LENS)

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """D share / d parameter, shape (m,)."""

    def changes(self, instrument: Instrument) -> bool:
        return isinstance(instrument, Camera) and self.where == _CAMERA + instrument.name

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        share = self.shares(poses)[:, None, None]
        away, grown = points - self.centre, 1.0 + share * values[..., None, None, :]
        turn = grown[..., None] * np.eye(2)
        return self.centre + grown * away, turn, (share * away)[..., None]
