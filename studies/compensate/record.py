"""What ``posecal compensate`` finds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies.joints import JointValues, check_same_joints, shown_joints
from studies.record import Count, Entry, Envelope, NotNegative, Number, Record

if TYPE_CHECKING:
    from calib import Compensation
    from calib.arm.robot import Robot
    from calib.arrays import Array

_MM = 1e3
_HOUR = 3600.0


class Distances(Entry):
    """By how much the targets are missed, with nominal and with corrected commands.

    left : what corrected commands cannot mend; expected : that and all that is uncertain
    """

    before: NotNegative
    left: NotNegative
    expected: NotNegative


class Rms(Distances):
    """The same over all targets, and what the expected error consists of beside ``left``.

    trend : how far the trend of the day will have gone by then
    """

    from_parameters: NotNegative
    scatter: NotNegative
    unexplained: NotNegative
    trend: NotNegative = 0.0


class Target(JointValues):
    """A target with its command: corrected, nominal, and the difference."""

    pose: str
    nominal_joints_deg: dict[str, Number]
    nominal_joints_mm: dict[str, Number] = Field(default_factory=dict)
    correction_joints_deg: dict[str, Number]
    correction_joints_mm: dict[str, Number] = Field(default_factory=dict)
    before_mm: NotNegative
    left_mm: NotNegative
    from_parameters_mm: NotNegative
    scatter_mm: NotNegative
    unexplained_mm: NotNegative | None = None
    trend_mm: NotNegative = 0.0
    expected_mm: NotNegative
    turn_before_mrad: NotNegative
    turn_left_mrad: NotNegative
    limited_by: str | None


class CompensateRecord(Record):
    """Corrected commands, and the error that is expected to remain.

    scatter_of : whose the scatter is: what these data do not tell from the model's lacks is undecided
    targets_after_h : hours after the last reading for which the error holds, where a trend goes on
    trend_an_hour_later_mm : how far it goes an hour later; None where there is none, or no time
    """

    command: Literal["compensate"] = "compensate"
    errors_at: Literal["markers", "tip"]
    rms_mm: Rms
    p95_mm: Distances
    max_mm: Distances
    unexplained_from: str
    scatter_of: Literal["arm", "undecided"] = "undecided"
    targets_after_h: NotNegative | None = None
    trend_an_hour_later_mm: NotNegative | None = None
    limited: dict[str, Count]
    targets: tuple[Target, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        check_same_joints(self.targets)
        return self


def compensate_record(robot: Robot, found: Compensation, made_from: Envelope) -> CompensateRecord:
    """The record of a compensation."""
    reasons = sorted({*found.limited_by} - {""})
    return CompensateRecord(
        **made_from,
        warnings=found.notes,
        errors_at="markers" if found.at == "markers" else "tip",
        rms_mm=Rms(
            before=found.rms(found.before) * _MM,
            left=found.rms(found.left) * _MM,
            expected=found.rms(found.expected) * _MM,
            from_parameters=found.rms(found.spread) * _MM,
            scatter=found.rms(found.scatter) * _MM,
            unexplained=found.rms(found.lacking) * _MM,
            trend=found.rms(found.trend) * _MM,
        ),
        p95_mm=_distances(found, 0.95),
        max_mm=_distances(found, 1.0),
        unexplained_from=found.unexplained.source,
        scatter_of="undecided" if found.rest_of == "undecided" else "arm",
        targets_after_h=None if found.after is None else found.after / _HOUR,
        trend_an_hour_later_mm=None
        if found.an_hour_on is None
        else found.rms(found.an_hour_on) * _MM,
        limited={reason: found.limited_by.count(reason) for reason in reasons},
        targets=tuple(_target(robot, found, i) for i in range(len(found.q))),
    )


def _distances(found: Compensation, share: float) -> Distances:
    """A quantile over the targets."""

    def shown(values: Array) -> float:
        return float(np.quantile(values, share)) * _MM

    return Distances(
        before=shown(found.before), left=shown(found.left), expected=shown(found.expected)
    )


def _target(robot: Robot, found: Compensation, i: int) -> Target:
    return Target(
        pose=found.targets.names[i],
        **shown_joints(robot, found.q[i]),
        **shown_joints(robot, found.targets.q[i], "nominal_"),
        **shown_joints(robot, found.correction[i], "correction_"),
        before_mm=float(found.before[i]) * _MM,
        left_mm=float(found.left[i]) * _MM,
        from_parameters_mm=float(found.spread[i]) * _MM,
        scatter_mm=float(found.scatter[i]) * _MM,
        unexplained_mm=float(found.lacking[i]) * _MM,
        trend_mm=float(found.trend[i]) * _MM,
        expected_mm=float(found.expected[i]) * _MM,
        turn_before_mrad=float(found.turn_before[i]) * 1e3,
        turn_left_mrad=float(found.turn_left[i]) * 1e3,
        limited_by=found.limited_by[i] or None,
    )
