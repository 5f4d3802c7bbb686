"""Objects that several results share: joint values, and how well parameters are known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Self

from studies.results.base import Entry, Maybe, Number

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.arrays import Array
    from calib.effects.protocol import Parameter


class JointValues(Entry):
    """Joint values by the joints' names."""

    joints_deg: dict[str, Number]
    joints_mm: dict[str, Number]

    @property
    def joints(self) -> dict[str, str]:
        """Joint with its unit -> value for a table."""
        turning = {f"{name} [deg]": f"{v:.2f}" for name, v in self.joints_deg.items()}
        return turning | {f"{name} [mm]": f"{v:.2f}" for name, v in self.joints_mm.items()}


def joint_values(robot: Robot, q: Array, prefix: str = "") -> dict[str, Any]:
    """Joint values, shape (n,), rad or m, as the fields of :class:`JointValues`.

    prefix : of the fields, as in ``nominal_joints_deg``
    """
    values: dict[str, dict[str, float]] = {f"{prefix}joints_deg": {}, f"{prefix}joints_mm": {}}
    for joint, slides, value in zip(robot.joints, robot.prismatic, q.tolist(), strict=True):
        shown = value * 1e3 if slides else math.degrees(value)
        values[f"{prefix}joints_{'mm' if slides else 'deg'}"][joint] = round(shown, 6) + 0.0
    return values


class NamedParameter(Entry):
    """A parameter by its name."""

    id: str
    effect: str
    where: str
    name: str

    @property
    def placed(self) -> bool:
        """Whether it says where base or markers are."""
        return self.effect in ("base", "tool")

    @classmethod
    def each(cls, parameters: Sequence[Parameter], **columns: Iterable[Any]) -> tuple[Self, ...]:
        """Every parameter; columns : further fields, a value each."""
        rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
        return tuple(
            cls(id=p.id, effect=p.effect, where=p.where, name=p.name, **row)
            for p, row in zip(parameters, rows, strict=True)
        )


class ParameterStd(NamedParameter):
    """A parameter and its standard deviation in its unit, None where that is open."""

    std: Maybe
    unit: str

    @classmethod
    def known(
        cls, parameters: Sequence[Parameter], std: Array, **columns: Iterable[Any]
    ) -> tuple[Self, ...]:
        """Every parameter; std : ndarray, shape (p,), SI; columns : further fields, a value each."""
        scales = [p.scale for p in parameters]
        return cls.each(parameters, std=std / scales, unit=[p.unit for p in parameters], **columns)
