"""Elastic pedestal: the base tilts under the overturning moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.effects.bearing_compliance import BearingCompliance
from calib.effects.context import Context, Expectation
from calib.effects.usual import softer


@dataclass(frozen=True, eq=False)
class BaseCompliance(BearingCompliance):
    """Tilt about the horizontal directions of the base frame (across its z axis)."""

    kind: ClassVar[str] = "base_compliance"
    turns: ClassVar[bool] = False
    # rad/(N m): a robot on a table or a light pedestal has up to 10, one on a telescopic column 15 to
    # 25 (base of the Hilti construction robot on five kinds of ground)
    largest: ClassVar[float] = 3e-5

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, 0, np.array([0.0, 0.0, 1.0]))

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context))
