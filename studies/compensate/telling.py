"""What a compensation says: the error before and after, what it consists of, and the commands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from studies import document as doc
from studies.compensate.record import CompensateRecord, Target
from studies.document import mm, plural
from studies.joints import joint_columns
from studies.noise import counts, lacks, moves_on, undecided
from studies.plots.errors import before_and_after
from studies.plots.style import BLUE, VERMILLION, Look, Picture, short

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
    errs = math.hypot(rms.from_parameters, rms.scatter, rms.unexplained, rms.trend)
    if counts(rms.unexplained, errs):
        yield doc.Sentence(f"More poses will not help: {lacks(rms.unexplained)}.", "warn")
    elif record.scatter_of == "undecided" and counts(rms.scatter, errs):
        yield doc.Sentence(f"Of it, {undecided(rms.scatter)}.", "note")
    if rms.trend:
        said = moves_on(rms.trend, record.trend_an_hour_later_mm, record.targets_after_h)
        yield doc.Sentence(f"{said}.", "warn")


def _parts(record: CompensateRecord) -> Iterator[doc.Part]:
    place = doc.Column[_ErrorRow](
        f"error of the {_PLACES[record.errors_at]}", lambda row: row.label
    )
    yield doc.Table((place, *_ERRORS), list(_errors(record)), "Errors at the targets")
    yield doc.Figure(lambda: errors_by_target(record), highlight=False)
    yield from _limited(record)
    commands: tuple[doc.Column[Target], ...] = (
        _POSE,
        *joint_columns(record.targets),
        _BEFORE,
        _EXPECTED,
    )
    yield doc.Detail((doc.Table(commands, record.targets, "Corrected commands"),))


@dataclass(frozen=True)
class _ErrorRow:
    """A distance over all targets, mm; None where only the RMS tells something."""

    label: str
    rms: float
    p95: float | None = None
    largest: float | None = None


_ERRORS: tuple[doc.Column[_ErrorRow], ...] = (
    doc.Column("RMS", lambda row: row.rms, doc.MM, "mm"),
    doc.Column("p95", lambda row: row.p95, doc.MM, "mm"),
    doc.Column("max", lambda row: row.largest, doc.MM, "mm"),
)


def _errors(record: CompensateRecord) -> Iterator[_ErrorRow]:
    rms, p95, most = record.rms_mm, record.p95_mm, record.max_mm
    yield _ErrorRow("nominal commands", rms.before, p95.before, most.before)
    yield _ErrorRow("corrected commands, expected", rms.expected)
    yield _ErrorRow("  of it: out of reach of any command", rms.left, p95.left, most.left)
    yield _ErrorRow("  of it: uncertainty of the parameters", rms.from_parameters)
    if rms.scatter:
        yield _ErrorRow(f"  of it: {_SCATTERS[record.scatter_of]}", rms.scatter)
    yield _ErrorRow("  of it: what the model lacks", rms.unexplained)
    if rms.trend:
        yield _ErrorRow("  of it: drift until then", rms.trend)


def errors_by_target(record: CompensateRecord) -> Picture:
    """By how much each target is missed, with its nominal and with its corrected command."""
    names = [target.pose for target in record.targets]
    series = [
        (_NOMINAL, np.array([target.before_mm for target in record.targets])),
        (_CORRECTED, np.array([target.expected_mm for target in record.targets])),
    ]
    figure = before_and_after(names, series, "error at the target [mm]", of="target", log=True)
    caption = (
        "By how much the arm misses each target with its nominal command, and is expected to with its "
        "corrected one: what is left is the parameters' uncertainty, what the model lacks, and what "
        "the arm cannot reach."
    )
    rows = tuple(
        (t.pose, t.before_mm, t.left_mm, t.expected_mm, t.limited_by) for t in record.targets
    )
    header = ("target", "before [mm]", "left [mm]", "expected [mm]", "limited by")
    was, now = (short(value, 2) for value in (record.rms_mm.before, record.rms_mm.expected))
    title = f"Error at each target: {was} mm RMS before, {now} mm expected after correction"
    return Picture("errors_by_target", title, caption, figure, header, rows)


_POSE: doc.Column[Target] = doc.Column("target", lambda row: row.pose)
_BEFORE: doc.Column[Target] = doc.Column("before", lambda row: row.before_mm, doc.MM, "mm")
_EXPECTED: doc.Column[Target] = doc.Column("expected", lambda row: row.expected_mm, doc.MM, "mm")
_LIMITED: tuple[doc.Column[Target], ...] = (
    _POSE,
    doc.Column("left", lambda row: row.left_mm, doc.MM, "mm"),
    doc.Column("turned", lambda row: row.turn_left_mrad, doc.MRAD, "mrad"),
    doc.Column("because", lambda row: row.limited_by, doc.TEXT),
)


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
