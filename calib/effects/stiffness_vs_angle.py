"""Compliance of a joint that depends on its own angle (the paper's chi_21 .. chi_25)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, joint_index, needs
from calib.effects.drive import ElasticDrive, along_axis, compliance_unit, moves_of
from calib.effects.protocol import Parameter
from calib.errors import CalibError
from calib.poses import Poses

_AT = "compliance@"


@dataclass(frozen=True, eq=False)
class StiffnessVsAngle(ElasticDrive):
    """Compliance with one coefficient at each knot, linear between, constant beyond the ends."""

    knots: Array
    kind: ClassVar[str] = "stiffness_vs_angle"
    parts: ClassVar[tuple[str, ...]] = ("joint_compliance",)
    flexible: ClassVar[bool] = True

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint = joint_index(context, where)
        needs(
            where in context.knots,
            f"{cls.kind}:{where}",
            "no angles are given and no poses to take them from",
            f"add [model.knots_deg] {where} = [..] to the cell",
        )
        along, knots = along_axis(context.robot, joint), np.sort(context.knots[where])
        return cls(where, joint + 1, along, knots, moves=moves_of(context, where))

    @classmethod
    def named(cls, context: Context, where: str, parameters: Sequence[str]) -> Self:
        joint = joint_index(context, where)
        try:
            shown = np.array([float(name.removeprefix(_AT)) for name in parameters])
        except ValueError:
            raise CalibError(f"{parameters[0][:40]!r} is no angle of a compliance") from None
        knots = shown * 1e-3 if context.robot.prismatic[joint] else np.radians(shown)
        return cls.at(replace(context, knots={where: knots}), where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(self.slides)
        shown = self.knots * 1e3 if self.slides else np.degrees(self.knots)
        return tuple(
            Parameter(self.kind, self.where, f"{_AT}{knot:.6g}", unit, scale, size)
            for knot in np.round(shown, 6) + 0.0
        )

    @property
    def varies_with(self) -> str:
        return f"q:{self.where}"

    def shares(self, poses: Poses) -> Array:
        q = poses.q[:, self.frame - 1]
        hats = [np.interp(q, self.knots, row) for row in np.eye(len(self.knots))]
        return np.column_stack(hats)
