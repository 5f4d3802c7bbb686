"""What ``posecal compensate`` finds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies.joints import JointValues, check_same_joints, shown_joints
from studies.record import BeforeAfter, Count, Entry, Envelope, NotNegative, Number, Record

if TYPE_CHECKING:
    from calib import Compensation
    from calib.arm.robot import Robot
    from calib.arrays import Array

_MM = 1e3  # and milliradians
_HOUR = 3600.0


class TargetErrors(Entry):
    """By how much the targets are missed, with nominal and with corrected commands.

    left : what corrected commands cannot mend; expected : that and all that is uncertain
    """

    before: NotNegative
    left: NotNegative
    expected: NotNegative


class Rms(TargetErrors):
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
    p95_mm: TargetErrors
    max_mm: TargetErrors
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

    @property
    def error(self) -> BeforeAfter:
        """At the targets, by nominal commands and as expected by the corrected ones."""
        return BeforeAfter(self.rms_mm.before, self.rms_mm.expected)


def compensate_record(robot: Robot, found: Compensation, made_from: Envelope) -> CompensateRecord:
    """The record of a compensation."""
    errors = {
        "before": found.before,
        "left": found.left,
        "expected": found.expected,
        "from_parameters": found.spread,
        "scatter": found.scatter,
        "unexplained": found.lacking,
        "trend": found.trend,
    }
    reasons = sorted({*found.limited_by} - {""})
    later = None if found.an_hour_on is None else found.rms(found.an_hour_on) * _MM
    return CompensateRecord(
        **made_from,
        warnings=found.notes,
        errors_at="markers" if found.at == "markers" else "tip",
        rms_mm=Rms(**{name: found.rms(own) * _MM for name, own in errors.items()}),
        p95_mm=_distances(found, 0.95),
        max_mm=_distances(found, 1.0),
        unexplained_from=found.unexplained.source,
        scatter_of="undecided" if found.rest_of == "undecided" else "arm",
        targets_after_h=None if found.after is None else found.after / _HOUR,
        trend_an_hour_later_mm=later,
        limited={reason: found.limited_by.count(reason) for reason in reasons},
        targets=tuple(_targets(robot, found, errors)),
    )


def _distances(found: Compensation, share: float) -> TargetErrors:
    """A quantile over the targets."""
    errors = {"before": found.before, "left": found.left, "expected": found.expected}
    return TargetErrors(**{n: float(np.quantile(own, share)) * _MM for n, own in errors.items()})


def _targets(robot: Robot, found: Compensation, errors: dict[str, Array]) -> Iterator[Target]:
    turns = {"turn_before_mrad": found.turn_before, "turn_left_mrad": found.turn_left}
    columns = {**{f"{name}_mm": own for name, own in errors.items()}, **turns}
    for i, name in enumerate(found.targets.names):
        lengths = {column: float(own[i]) * _MM for column, own in columns.items()}
        yield Target.model_validate(
            {
                "pose": name,
                **shown_joints(robot, found.q[i]),
                **shown_joints(robot, found.targets.q[i], "nominal_"),
                **shown_joints(robot, found.correction[i], "correction_"),
                **lengths,
                "limited_by": found.limited_by[i] or None,
            }
        )
