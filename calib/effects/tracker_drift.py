"""Slow motion of the instrument: a tripod that settles or warms, zero at the first pose in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.effects.drift import drift_parameters, drifted
from calib.effects.protocol import Parameter, ReadingEffect
from calib.poses import Poses
from calib.se3 import Array, rotate, skew, so3_exp, so3_right_jacobian


@dataclass(frozen=True, eq=False)
class TrackerDrift(ReadingEffect):
    """Readings move as one body at constant rates along and about the axes of their station."""

    kind: ClassVar[str] = "tracker_drift"
    uses: ClassVar[tuple[str, ...]] = ("time",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return drift_parameters(self.kind, self.where)

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        xi = drifted(values, poses)[..., None, :]  # one for all markers of a pose
        R = so3_exp(xi[..., 3:])
        turn = -R @ skew(points) @ so3_right_jacobian(xi[..., 3:])
        both = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=-1)
        columns = poses.elapsed[:, None, None, None] * both
        return rotate(R, points) + xi[..., :3], R, columns
