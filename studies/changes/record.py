"""What ``posecal changes`` finds, and how it is told."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from studies import document as doc
from studies.document import P, Shown, listed, mm
from studies.record import (
    OWN_UNIT,
    Count,
    Entry,
    From,
    IntervalEntry,
    Maybe,
    MaybePositive,
    NotNegative,
    Number,
    Positive,
    Record,
)


class ChangedParameter(Entry):
    """A parameter, after minus before; family_p : by chance, over all parameters together."""

    id: str
    change: Annotated[Number, OWN_UNIT]
    std: Annotated[MaybePositive, Shown("standard\ndeviation"), OWN_UNIT]
    family_p: Annotated[Maybe, Shown("p, of all\ntogether", P)]
    moved: bool
    unit: str


class ChangesRecord(Record):
    """What moved between two results of one robot.

    p : of so large a difference in so many independent rows, where nothing changed
    apart : bases and markers that stand elsewhere and are not compared
    change : of the robot between the days; kept : error with the values of BEFORE on that of AFTER
    """

    command: Literal["changes"] = "changes"
    before: str
    after: str
    status: Literal["unchanged", "changed"]
    p: Annotated[NotNegative, From("p_value")]
    rows: Annotated[Count, From("whitened")]
    parameters: tuple[ChangedParameter, ...] = Field(min_length=1)
    apart: tuple[str, ...]
    change_rms_mm: Annotated[IntervalEntry, From("there")]
    kept_rms_mm: Annotated[IntervalEntry, From("kept.0")]
    kept_worst_mm: Annotated[IntervalEntry, From("kept.1")]
    tolerance_mm: Positive | None
    verdict: Literal["holds", "does_not", "cannot_be_said"] | None


_SAID: dict[str, tuple[str, doc.Mood]] = {
    "holds": ("still holds", "good"),
    "does_not": ("does not hold", "warn"),
    "cannot_be_said": ("may or may not hold", "warn"),
}
_PARAMETERS = doc.columns(
    ChangedParameter,
    "id",
    doc.Column("after -\nbefore", lambda p: (p.change, p.std) if p.std else None, doc.TO_STD),
    "std unit family_p",
    doc.Column("moved", lambda p: "yes" if p.moved else "", doc.TEXT),
)


def told(record: ChangesRecord) -> doc.Document:
    """Whether anything moved, whether the calibration holds, and the parameters."""
    rows = sorted(record.parameters, key=lambda p: 2.0 if p.family_p is None else p.family_p)
    table = doc.Table(_PARAMETERS, rows, "Parameters, after minus before", most=12)
    return doc.Document(tuple(_said(record)), (doc.Section("changes", "What moved", (table,)),))


def _said(record: ChangesRecord) -> Iterator[doc.Sentence]:
    between = f"between {record.before} and {record.after} (p = {doc.P(record.p)})"
    if record.status == "unchanged":
        yield doc.Sentence(f"Nothing moved {between}.", "good")
        hidden = mm(record.change_rms_mm.high)
        yield doc.Sentence(f"A change below {hidden} RMS at the targets would go unnoticed.")
    else:
        size = f"{_shown(record.change_rms_mm)} RMS at the targets"
        yield doc.Sentence(f"Something moved {between}: {size}.", "warn")
        yield doc.Sentence(f"moved: {listed([p.id for p in record.parameters if p.moved])}")
    said, mood = _SAID.get(record.verdict or "", ("would err", ""))
    within = f" within {record.tolerance_mm:g} mm" if record.tolerance_mm else " today"
    worst = f"worst target {_shown(record.kept_worst_mm)}"
    yield doc.Sentence(f"{record.before} {said}{within}: {worst}.", mood)
    if record.apart:
        apart = f"{listed(record.apart)} stood elsewhere and cannot be compared"
        yield doc.Sentence(f"{apart}; a knock of the robot's base looks like a moved instrument.")


def _shown(error: IntervalEntry) -> str:
    return f"{doc.MM(error.value)} mm ({doc.MM(error.low)} to {doc.MM(error.high)})"
