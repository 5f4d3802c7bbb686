"""Objects that several results share: joint values, and how well parameters are known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.protocol import Parameter
from calib.poses import Measurements
from studies.results.base import Entry, Maybe, NotNegative, Number


class JointValues(Entry):
    """Joint values by the joints' names."""

    joints_deg: dict[str, Number]
    joints_mm: dict[str, Number]

    @property
    def joints(self) -> dict[str, str]:
        """Joint with its unit -> value for a table."""
        turning = {f"{name} [deg]": f"{v:.2f}" for name, v in self.joints_deg.items()}
        return turning | {f"{name} [mm]": f"{v:.2f}" for name, v in self.joints_mm.items()}


class Conditions(JointValues):
    """Under which conditions a pose was read; heldout : whether it took no part in the fit."""

    pose: str
    heldout: bool
    force_N: NotNegative
    time_s: Maybe
    temperature_degC: Maybe

    @classmethod
    def each(cls, robot: Robot, data: Measurements, heldout: bool) -> Iterator[Self]:
        """Those of every pose of a table."""
        poses, unknown = data.poses, [None] * len(data)
        times = unknown if poses.time is None else poses.time.tolist()
        heat = unknown if poses.temperature is None else poses.temperature.tolist()
        force = np.linalg.norm(poses.wrench[:, :3], axis=-1).tolist()
        for pose, q, f, t, T in zip(poses.names, poses.q, force, times, heat, strict=True):
            values = joint_values(robot, q)
            yield cls(**values, pose=pose, heldout=heldout, force_N=f, time_s=t, temperature_degC=T)

    @property
    def variables(self) -> dict[str, float]:
        """What an error may depend on, by its label with its unit."""
        hours = None if self.time_s is None else self.time_s / 3600.0
        found = {f"{joint} [deg]": value for joint, value in self.joints_deg.items()}
        found |= {f"{joint} [mm]": value for joint, value in self.joints_mm.items()}
        found |= {"force on the tool [N]": self.force_N}
        more = {"time [h]": hours, "temperature [degC]": self.temperature_degC}
        return found | {label: value for label, value in more.items() if value is not None}


def joint_array(robot: Robot, rows: Sequence[JointValues]) -> Array | None:
    """Joint values of poses, shape (m, n), rad or m; None where they are of other joints."""
    values = [{**row.joints_deg, **row.joints_mm} for row in rows]
    if not values or any(set(row) != set(robot.joints) for row in values):
        return None
    scale = np.where(robot.prismatic, 1e-3, np.pi / 180.0)
    return np.array([[row[joint] for joint in robot.joints] for row in values]) * scale


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
