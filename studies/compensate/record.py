"""What ``posecal compensate`` finds, and how it is told: the error before and after, the commands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from studies import document as doc
from studies.document import Shown, mm, plural
from studies.entries import JointValues, joint_columns, shown_joints
from studies.noise import counts, lacks, undecided
from studies.plots.style import BLUE, VERMILLION, Look
from studies.record import BeforeAfter, Count, Entry, Envelope, From, NotNegative, Number, Record

if TYPE_CHECKING:
    from calib import Cell, Compensation
    from calib.arm.robot import Robot


class CorrectedErrors(Entry):
    """By how much the targets are missed, with nominal and with corrected commands.

    left : what corrected commands cannot mend; expected : that and all that is uncertain
    """

    before: NotNegative
    left: NotNegative
    expected: NotNegative


class RmsErrors(CorrectedErrors):
    """The same over all targets, and what the expected error consists of beside ``left``."""

    from_parameters: NotNegative
    scatter: NotNegative
    unexplained: NotNegative


class Target(JointValues):
    """A target with its command: corrected, nominal, and the difference."""

    pose: Annotated[str, Shown("target")]
    nominal_joints_deg: dict[str, Number]
    nominal_joints_mm: dict[str, Number]
    correction_joints_deg: dict[str, Number]
    correction_joints_mm: dict[str, Number]
    before_mm: NotNegative
    left_mm: NotNegative
    from_parameters_mm: NotNegative
    scatter_mm: NotNegative
    unexplained_mm: NotNegative | None
    expected_mm: NotNegative
    turn_before_mrad: NotNegative
    turn_left_mrad: Annotated[NotNegative, Shown("turned")]
    limited_by: Annotated[str | None, Shown("because")]


class CompensateRecord(Record):
    """Corrected commands, and the error that is expected to remain.

    scatter_of : whose the scatter is: what these data do not tell from the model's lacks is undecided
    not_clear : what the arm meets at a corrected command, by target
    """

    command: Literal["compensate"] = "compensate"
    errors_at: Literal["markers", "tip"]
    rms_mm: RmsErrors
    p95_mm: CorrectedErrors
    max_mm: CorrectedErrors
    unexplained_from: Annotated[str, From("error.estimate.discrepancy.source")]
    scatter_of: Literal["arm", "undecided"]
    limited: dict[str, Count]
    not_clear: dict[str, str]
    targets: tuple[Target, ...] = Field(min_length=1)

    @property
    def error(self) -> BeforeAfter:
        """At the targets, by nominal commands and as expected by the corrected ones."""
        of = "RMS error at the targets, expected after correction"
        return BeforeAfter(self.rms_mm.before, self.rms_mm.expected, of)


def compensate_record(cell: Cell, found: Compensation, made_from: Envelope) -> CompensateRecord:
    """The record of a compensation."""
    from doe.constraints import broken_at

    robot = cell.robot
    errors = {
        "before": found.before,
        "left": found.left,
        "expected": found.expected,
        "from_parameters": found.error.parameters,
        "scatter": found.error.arm,
        "unexplained": found.error.model,
    }
    reasons = sorted({*found.limited_by} - {""})
    over_all = {
        "rms": {name: found.rms(own) for name, own in errors.items()},
        "p95": {name: np.quantile(errors[name], 0.95) for name in CorrectedErrors.model_fields},
        "max": {name: np.max(errors[name]) for name in CorrectedErrors.model_fields},
    }
    return CompensateRecord.from_result(
        over_all,
        found,
        **made_from,
        warnings=found.notes,
        errors_at="markers" if found.at == "markers" else "tip",
        scatter_of="undecided" if found.error.estimate.configuration_of == "undecided" else "arm",
        not_clear={
            name: met
            for name, met in zip(found.targets.names, broken_at(cell, found.q), strict=True)
            if met
        },
        limited={reason: found.limited_by.count(reason) for reason in reasons},
        targets=Target.from_each(
            _commands(robot, found),
            pose=found.targets.names,
            turn_before=found.turn_before,
            turn_left=found.turn_left,
            limited_by=[reason or None for reason in found.limited_by],
            **errors,
        ),
    )


def _commands(robot: Robot, found: Compensation) -> Iterator[dict[str, dict[str, float]]]:
    """Joints of each target as corrected, nominal, and their difference."""
    for own, nominal, correction in zip(found.q, found.targets.q, found.correction, strict=True):
        yield {
            **shown_joints(robot, own),
            **shown_joints(robot, nominal, "nominal_"),
            **shown_joints(robot, correction, "correction_"),
        }


_MOST = 8  # targets that are worth a line each
_NOMINAL = Look("nominal command", VERMILLION, "^", "", "", "▲")
_CORRECTED = Look("corrected command, expected", BLUE, "o", "", "", "●")
_PLACES = {"markers": "markers", "tip": "tip's origin"}
_SCATTERS = {
    "arm": "the arm's repeatability",
    "undecided": "the arm's repeatability, or what the model lacks",
}


def told(record: CompensateRecord) -> doc.Document:
    """The error before and after, and the commands that it takes."""
    section = doc.Section("compensation", "Corrected commands", tuple(_parts(record)))
    return doc.Document((_headline(record), *_missing(record)), (section,))


def _headline(record: CompensateRecord) -> doc.Sentence:
    rms = record.rms_mm
    return doc.Sentence(
        f"Expected error at {plural(len(record.targets), 'target')}: {mm(rms.before)} RMS before, "
        f"{mm(rms.expected)} after correction.",
        "good" if rms.expected < rms.before else "warn",
    )


def _missing(record: CompensateRecord) -> Iterator[doc.Sentence]:
    """What is expected holds as long as nothing else is missing, and where the day has not ended."""
    rms = record.rms_mm
    errs = math.hypot(rms.from_parameters, rms.scatter, rms.unexplained)
    if counts(rms.unexplained, errs):
        yield doc.Sentence(f"More poses will not help: {lacks(rms.unexplained)}.", "warn")
    elif record.scatter_of == "undecided" and counts(rms.scatter, errs):
        yield doc.Sentence(f"Of it, {undecided(rms.scatter)}.", "note")


def _parts(record: CompensateRecord) -> Iterator[doc.Part]:
    place = f"error of the {_PLACES[record.errors_at]}"
    columns = doc.heads(place, "RMS [mm]", "p95 [mm]", "max [mm]")
    yield doc.Table(columns, list(_errors(record)), "Errors at the targets")
    yield from _not_clear(record)
    yield from _limited(record)
    joints = joint_columns(record.targets)
    commands = doc.columns(Target, "pose", *joints, "before_mm expected_mm")
    yield doc.Detail((doc.Table(commands, record.targets, "Corrected commands"),))


def _not_clear(record: CompensateRecord) -> Iterator[doc.Part]:
    """Where the arm does not keep clear at corrected commands."""
    for name, met in list(record.not_clear.items())[:_MOST]:
        yield doc.Sentence(
            f"at the corrected command of {name} the arm does not keep clear: {met}", "warn"
        )


_ErrorRow: TypeAlias = tuple[str, float, float | None, float | None]
"""Of which error; RMS over the targets, 95th percentile and largest, mm, where they tell something."""


def _errors(record: CompensateRecord) -> Iterator[_ErrorRow]:
    rms, p95, most = record.rms_mm, record.p95_mm, record.max_mm
    yield "nominal commands", rms.before, p95.before, most.before
    yield "corrected commands, expected", rms.expected, None, None
    yield "  of it: out of reach of any command", rms.left, p95.left, most.left
    yield "  of it: uncertainty of the parameters", rms.from_parameters, None, None
    if rms.scatter:
        yield f"  of it: {_SCATTERS[record.scatter_of]}", rms.scatter, None, None
    yield "  of it: what the model lacks", rms.unexplained, None, None


_LIMITED = doc.columns(Target, "pose left_mm turn_left_mrad limited_by")


def _limited(record: CompensateRecord) -> Iterator[doc.Part]:
    """Targets that no command reaches, those that are missed most first."""
    limited = [target for target in record.targets if target.limited_by]
    if not limited:
        return
    why = ", ".join(f"{reason} ({count})" for reason, count in record.limited.items())
    said = f"{len(limited)} of {len(record.targets)} targets are only partly corrected: {why}."
    yield doc.Sentence(said, "warn")
    limited.sort(key=lambda target: -target.left_mm)
    yield doc.Table(_LIMITED, limited, "Targets that are only partly corrected", most=_MOST)
