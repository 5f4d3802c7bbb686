"""Corrected commands: what the arm would miss without them, and what is expected to remain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies.report.evidence import Evidence, Result
from studies.report.parts import Part, Section, Table, Text, folded, joint_columns

_ROWS = (
    ("with nominal commands", "before"),
    ("with corrected commands, expected", "expected"),
    ("of it: cannot be corrected", "left"),
    ("of it: uncertainty of the parameters", "from_parameters"),
    ("of it: the arm errs anew at each pose", "scatter"),
    ("of it: not explained by the model", "unexplained"),
)


def compensation(evidence: Evidence, result: Result) -> Section:
    """The error at the targets before and after, and the commands."""
    return Section("compensation", "Corrected commands", tuple(_parts(result.fields)))


def _parts(fields: dict[str, Any]) -> Iterator[Part]:
    figures = [
        (label, *(_mm(fields[figure].get(key)) for figure in ("rms_mm", "p95_mm", "max_mm")))
        for label, key in _ROWS
        if key != "scatter" or fields["rms_mm"].get(key)
    ]
    yield Table(
        ("distance from the wanted place", "RMS [mm]", "p95 [mm]", "max [mm]"),
        figures,
        f"Error of {len(fields['targets'])} targets, at the {fields['errors_at']}",
    )
    for reason, count in fields["limited"].items():
        are = "target is" if count == 1 else "targets are"
        yield Text(f"{count} {are} not met in full: {reason}.", "warn")
    joints = joint_columns(fields["targets"])
    rows = [
        (
            target["pose"],
            *(f"{target[key][name]:.4f}" for _, key, name in joints),
            *(f"{target[f'{part}_mm']:.4f}" for part in ("before", "expected")),
        )
        for target in fields["targets"]
    ]
    yield Table(
        (
            "target", *(title for title, _, _ in joints), "before [mm]", "expected [mm]",
        ),
        rows,
        fold=folded("Corrected commands", rows),
    )  # fmt: skip


def _mm(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"
