"""Gear errors that repeat many times a turn: ``dq = cos_1 cos(c q) + sin_1 sin(c q)``, q as read.

A strain-wave gear of ratio N has errors once and twice a turn of its wave generator: c = N and c
= 2 N a turn of the joint. A motor encoder has errors once a turn of the motor: c = N. The second
harmonic has twice the cycles. Errors with one or two cycles a turn of the joint are a
``transmission_harmonic``. Between two cycles and the ratio of a slow gear no part of a drive turns.
Such cycles are not tried, because any smooth error would fit them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, joint_index, turning_joints
from calib.effects.joint import along_axis
from calib.effects.protocol import FrameEffect, Parameter
from calib.effects.tuned import ANY_TUNING, Tuned
from calib.poses import Poses

_USUAL = 200.0  # cycles a turn: a strain-wave gear of ratio 100
FEWEST = 15.0
"""Cycles a turn of the joint below which no gear is meant."""
_MOST = 450.0  # ratios of strain-wave gears reach 160, their second harmonic 640
_STEP = 0.25  # of a line's width
_LINE = 2.0  # widths: farther away it is another line
_SAME = 0.8  # of a ripple's square: so much at other cycles, and nobody says which are right
_SIZE, _LARGEST = 1e-4, 1.5e-3  # rad: real arms show 20 to 150 urad


@dataclass(frozen=True, eq=False)
class GearRipple(Tuned, FrameEffect):
    """A line of a joint's error over cycles a turn, with one harmonic or two.

    harmonics : 1 or 2
    ratio : float or None, turns of motor or wave generator a turn of the joint, where it is known
    """

    harmonics: int
    ratio: float | None
    kind: ClassVar[str] = "gear_ripple"
    lines: ClassVar[int] = 2

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return turning_joints(context)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint, ratio = joint_index(context, where), context.gear_ratios.get(where)
        return cls(
            where=where,
            tuning=_USUAL if ratio is None else 2.0 * ratio,
            frame=joint + 1,
            directions=along_axis(context.robot, joint)[:, None],
            harmonics=2 if "cos_2" in (context.parameters or ()) else 1,
            ratio=ratio,
        )

    def with_harmonics(self, count: int) -> Self:
        """The same with so many harmonics, 1 or 2."""
        return replace(self, harmonics=count)

    @property
    def tuning_parameter(self) -> Parameter:
        return self.parameter("cycles", "1/turn", 1.0, ANY_TUNING)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        names = [f"{f}_{k}" for k in range(1, self.harmonics + 1) for f in ("cos", "sin")]
        return tuple(self.parameter(name, "urad", _SIZE, _LARGEST) for name in names)

    def functions(self, poses: Poses, tuning: Array) -> Array:
        phase = self._phases(poses, tuning)
        return _paired(np.cos(phase), np.sin(phase))

    def slopes(self, poses: Poses, tuning: Array) -> Array:
        phase, rate = self._phases(poses, tuning), self._phases(poses, np.ones(()))
        return _paired(-rate * np.sin(phase), rate * np.cos(phase))

    def _phases(self, poses: Poses, tuning: Array) -> Array:
        """Phase of each harmonic, shape (..., m, harmonics), rad."""
        q = poses.q[:, self.frame - 1, None] * np.arange(1.0, self.harmonics + 1.0)
        return np.asarray(tuning)[..., None, None] * q

    def grid(self, poses: Poses) -> Array:
        if self.ratio is not None:
            return np.array([self.ratio, 2.0 * self.ratio])
        width = self.width(poses)
        return np.arange(FEWEST, _MOST, _STEP * width) if np.isfinite(width) else np.zeros(0)

    def richer(self, tunings: Array) -> tuple[Self, Array]:
        """With its second harmonic; the line that is best so far may be that harmonic."""
        cycles = np.concatenate([tunings, 0.5 * tunings])
        return self.with_harmonics(2), cycles[cycles >= FEWEST]

    def aliases(self, poses: Poses, values: Array) -> Array:
        """Lines of a joint at equal steps."""
        width = self.width(poses)
        if not np.isfinite(width):
            return np.zeros(0)
        tried = np.arange(FEWEST, _MOST, _STEP * width)
        tried = tried[np.abs(tried - values[0]) > _LINE * width]
        error = self.amounts(poses, values)[:, 0]
        F = self.functions(poses, tried)
        shared = np.swapaxes(F, -1, -2) @ error
        inner = np.linalg.pinv(np.swapaxes(F, -1, -2) @ F, hermitian=True)
        explained = np.einsum("ci,cij,cj->c", shared, inner, shared)
        return np.asarray(tried[explained > _SAME * float(error @ error)])

    def width(self, poses: Poses) -> float:
        """Width of a line in cycles a turn, infinite where the joint stands still."""
        extent = float(np.ptp(poses.q[:, self.frame - 1])) if len(poses) else 0.0
        return 2.0 * np.pi / extent if extent > 0.0 else np.inf


def _paired(cosine: Array, sine: Array) -> Array:
    """``cos_1 sin_1 cos_2 sin_2`` of two arrays (..., m, harmonics)."""
    return np.stack([cosine, sine], axis=-1).reshape(*cosine.shape[:-1], 2 * cosine.shape[-1])
