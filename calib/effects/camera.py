"""What a camera reads wrongly: a lens that is not the one that the cell gives, value by value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.protocol import Effect, Parameter
from calib.effects.readings import ReadingEffect
from calib.instruments import Camera, Instrument
from calib.instruments.lens import CENTER, DISTORTION, FOCAL, Lens
from calib.poses import Poses

_OFF, _FAR = 3e-3, 5e-2  # of the focal length: plausible and largest error of it and of the centre
_BENT, _VERY = 2e-2, 1.0  # of a coefficient of distortion
_FIRST = 10.0  # odds: of an arm and a camera the camera is looked at first


@dataclass(frozen=True, eq=False)
class LensEffect(ReadingEffect):
    """Some values of a camera's lens, at the place ``camera:NAME``, differ from the cell's.

    lens : Lens, as the cell gives it; values : slice, which of its values
    """

    lens: Lens
    values: ClassVar[slice]
    of: ClassVar[str] = "camera"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(where for where, camera in _cameras(context).items() if cls.acts(camera))

    @classmethod
    def acts(cls, camera: Camera) -> bool:
        """Whether it is an error of its own beside what is free of this camera."""
        return not np.isin(np.arange(len(camera.lens.values))[cls.values], camera.free).any()

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        return cls(where, _cameras(context)[where].lens)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(odds=_FIRST)

    def changes(self, instrument: Instrument) -> bool:
        return isinstance(instrument, Camera) and self.where == f"camera:{instrument.name}"

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        """Each pixel is led back to its ray by the cell's lens, and on by the true one."""
        ideal = self.lens.ideal(points)
        ray = np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)
        _, by_ray, _ = self.lens.linearise(ray)
        by = np.zeros((*values.shape[:-1], len(self.lens.values)))
        by[..., self.values] = values
        pixels, by_true, by_lens = self.lens.moved(by).linearise(ray)
        turn = by_true[..., :2] @ np.linalg.inv(by_ray[..., :2])
        return pixels, turn, by_lens[..., self.values]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        focal = float(self.lens.values[FOCAL].mean())
        limits = ("px", _OFF * focal, _FAR * focal)
        if self.values == DISTORTION:
            limits = ("1", _BENT, _VERY)
        return tuple(self.parameter(name, *limits) for name in self.lens.names[self.values])


def _cameras(context: Context) -> dict[str, Camera]:
    return {f"camera:{i.name}": i for i in context.instruments if isinstance(i, Camera)}


class Focal(LensEffect):
    """Both focal lengths, each by its own amount: an old calibration, or a lens that was refocused."""

    kind: ClassVar[str] = "focal"
    values: ClassVar[slice] = FOCAL


class PrincipalPoint(LensEffect):
    """The point where the optical axis meets the image."""

    kind: ClassVar[str] = "principal_point"
    values: ClassVar[slice] = CENTER


class Distortion(LensEffect):
    """The coefficients of OpenCV's radial and tangential distortion."""

    kind: ClassVar[str] = "distortion"
    values: ClassVar[slice] = DISTORTION
    first: ClassVar[bool] = True
