"""Links that are longer than the nominal model by one share: a warm arm, or a file of another size.

Beside a base and a tool that are free a board of another size looks alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import ARM, Context
from calib.effects.geometry import Geometry
from calib.effects.protocol import Effect, Parameter, PoseEffect, Twist
from calib.effects.thermal_expansion import translations
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class LinkScale(PoseEffect):
    """Growth of every link, asked where boards alone give the scale: trackers have their own.

    lengths : ndarray, shape (n + 1, 3), m, the links' translations in the axes of their end frames
    """

    lengths: Array
    kind: ClassVar[str] = "link_scale"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        boards = any(part.board is not None for part in context.parts.values())
        return (ARM,) if boards else ()

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, translations(context.robot))

    @classmethod
    def repeats(cls, where: str, active: Sequence[Effect]) -> str | None:
        return "" if any(isinstance(effect, Geometry) for effect in active) else None

    @property
    def varies_with(self) -> str:
        return "none"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 5e-4, 5e-3),)

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        slides = np.column_stack([self.lengths, np.zeros_like(self.lengths)])
        return tuple((frame, own[None, :, None]) for frame, own in enumerate(slides, 1))
