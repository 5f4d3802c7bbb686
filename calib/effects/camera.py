"""What a camera reads wrongly: the base of all errors of a camera, at the place ``camera:NAME``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.context import Context, Expectation
from calib.effects.protocol import Effect
from calib.effects.readings import ReadingEffect
from calib.instruments import Camera, Instrument

_CAMERA = "camera:"
_FIRST = 10.0  # odds: of an arm and a camera the camera is looked at first


@dataclass(frozen=True, eq=False)
class CameraEffect(ReadingEffect):
    """The camera's pixels are not those of the lens that the cell gives."""

    of: ClassVar[str] = "camera"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        cameras = (i for i in context.instruments if isinstance(i, Camera))
        return tuple(_CAMERA + camera.name for camera in cameras if cls.acts(camera))

    @classmethod
    def acts(cls, camera: Camera) -> bool:
        """Whether it is an error of its own beside what is free of this camera."""
        del camera
        return True

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        cameras = (i for i in context.instruments if isinstance(i, Camera))
        return cls.made(context, where, next(i for i in cameras if _CAMERA + i.name == where))

    @classmethod
    def made(cls, context: Context, where: str, camera: Camera) -> Self:
        """The effect at a camera."""
        raise NotImplementedError

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(odds=_FIRST)

    def changes(self, instrument: Instrument) -> bool:
        return isinstance(instrument, Camera) and self.where == _CAMERA + instrument.name
