"""Focal length that changes with temperature; the cell's value holds at 20 degC."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.arrays import Array
from calib.effects.focal import FocalEffect
from calib.effects.protocol import Parameter
from calib.poses import Poses

# 1/K: plastic mounts and lenses reach some 1e-4.
_LARGEST = 1e-3


@dataclass(frozen=True, eq=False)
class FocalExpansion(FocalEffect):
    """Both focal lengths grow in proportion to the warming."""

    kind: ClassVar[str] = "focal_expansion"
    uses: ClassVar[tuple[str, ...]] = ("temperature",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "growth", "ppm/K", 1e-6, 2e-5, _LARGEST),)

    def shares(self, poses: Poses) -> Array:
        return poses.warming
