"""The JSON of ``posecal compensate``: corrected commands, and the error expected to remain."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field

from calib import Cell, Compensation
from doe.constraints import broken_at
from studies.results.base import (
    MM,
    BeforeAfter,
    Count,
    Entry,
    Envelope,
    NotNegative,
    Number,
    Result,
)
from studies.results.expected import ExpectedErrors
from studies.results.parts import JointValues, joint_values

_MRAD = 1e3


class CorrectedErrors(Entry):
    """By how much the targets are missed, with nominal and with corrected commands.

    left : what corrected commands cannot mend; expected : that and all that is uncertain
    """

    before: NotNegative
    left: NotNegative
    expected: NotNegative


class CorrectedTarget(JointValues):
    """A target with its command: corrected, nominal, and the difference."""

    pose: str
    nominal_joints_deg: dict[str, Number]
    nominal_joints_mm: dict[str, Number]
    correction_joints_deg: dict[str, Number]
    correction_joints_mm: dict[str, Number]
    before_mm: NotNegative
    left_mm: NotNegative
    expected_mm: NotNegative
    turn_before_mrad: NotNegative
    turn_left_mrad: NotNegative
    limited_by: str | None


class CompensateResult(Result):
    """Corrected commands, and the error that is expected to remain.

    expected : of the corrected commands, beside what they cannot mend
    not_clear : what the arm meets at a corrected command, by target
    """

    command: Literal["compensate"] = "compensate"
    errors_at: Literal["markers", "tip"]
    rms_mm: CorrectedErrors
    p95_mm: CorrectedErrors
    max_mm: CorrectedErrors
    expected: ExpectedErrors
    limited: dict[str, Count]
    not_clear: dict[str, str]
    targets: tuple[CorrectedTarget, ...] = Field(min_length=1)

    @classmethod
    def of(cls, found: Compensation, cell: Cell, made_from: Envelope) -> Self:
        """A compensation in a cell."""
        robot, names = cell.robot, found.targets.names
        errors = {"before": found.before, "left": found.left, "expected": found.expected}
        reasons = sorted({*found.limited_by} - {""})
        return cls(
            **made_from,
            warnings=found.notes,
            errors_at="markers" if found.at == "markers" else "tip",
            rms_mm=CorrectedErrors(**{k: found.rms(own) * MM for k, own in errors.items()}),
            p95_mm=CorrectedErrors(**{k: np.quantile(own, 0.95) * MM for k, own in errors.items()}),
            max_mm=CorrectedErrors(**{k: np.max(own) * MM for k, own in errors.items()}),
            expected=ExpectedErrors.of(found.error, found.weights),
            limited={reason: found.limited_by.count(reason) for reason in reasons},
            not_clear={
                n: met for n, met in zip(names, broken_at(cell, found.q), strict=True) if met
            },
            targets=tuple(
                CorrectedTarget(
                    pose=name,
                    **joint_values(robot, found.q[i]),
                    **joint_values(robot, found.targets.q[i], "nominal_"),
                    **joint_values(robot, found.correction[i], "correction_"),
                    **{f"{kind}_mm": own[i] * MM for kind, own in errors.items()},
                    turn_before_mrad=found.turn_before[i] * _MRAD,
                    turn_left_mrad=found.turn_left[i] * _MRAD,
                    limited_by=found.limited_by[i] or None,
                )
                for i, name in enumerate(names)
            ),
        )

    @property
    def main_table(self) -> tuple[CorrectedTarget, ...]:
        return self.targets

    @property
    def error(self) -> BeforeAfter:
        """At the targets, by nominal commands and as expected by the corrected ones."""
        of = "RMS error at the targets, expected after correction"
        return BeforeAfter(self.rms_mm.before, self.rms_mm.expected, of)
