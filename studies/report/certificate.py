"""What a calibration certificate must hold (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), as far as known.

Whose certificate it is, nobody can tell from figures: the page never says that it is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from studies.document import Section, Sentence, Table, heads, mm, plural
from studies.identify.record import IdentifyRecord
from studies.report.evidence import ReportedResult, ReportEvidence

_ASKED: dict[str, tuple[str, ...]] = {
    "number of the certificate": ("certificate", "number"),
    "laboratory": ("laboratory",),
    "place of the calibration": ("place", "laboratory"),
    "customer": ("customer",),
    "robot, maker and model": ("robot", "model"),
    "serial number": ("serial",),
    "condition as received": ("condition",),
    "measured on": ("measured", "date"),
    "issued on": ("issued",),
    "procedure": ("procedure",),
    "instrument and its certificate": ("instrument",),
    "traceable to": ("traceability",),
    "environment": ("environment",),
    "operator": ("operator",),
    "authorised by": ("authorised_by",),
}
"""Fields and the keys of [report] that fill them, the first that is there."""

_FIELDS = heads("field", "as known")
_DISCLAIMER = (
    "Fields that ISO/IEC 17025 asks of a calibration certificate, as far as the cell's [report] and "
    "this result fill them. This page is no certificate and claims no accreditation: that is a "
    "laboratory's. The results hold for the robot named here, as it was when it was measured."
)


def certificate(evidence: ReportEvidence, told: Mapping[str, str]) -> Iterator[Section]:
    """One section for the first identification of a cell that tells of itself or has a tolerance."""
    result = evidence.first("identify")
    if result is None or not isinstance(result.record, IdentifyRecord):
        return
    record = result.record
    if not record.about and record.acceptance is None:
        return
    about = {**record.about, **told}
    used = {key for keys in _ASKED.values() for key in keys}
    rows = [
        *_asked(about),
        *_found(evidence, result, record),
        *((key, value) for key, value in about.items() if key not in used),
    ]
    yield Section(
        "certificate",
        "For a certificate",
        (Sentence(_DISCLAIMER, "note"), Table(_FIELDS, rows, fold=False)),
    )


def _asked(about: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for label, keys in _ASKED.items():
        known = (about[key] for key in keys if key in about)
        yield label, next(known, f"not given; write {keys[0]} into [report]")


def _found(
    evidence: ReportEvidence, result: ReportedResult, record: IdentifyRecord
) -> Iterator[tuple[str, str]]:
    yield (
        "method",
        f"parameters identified from {plural(record.poses, 'reading')}, "
        f"{plural(record.points, 'point')}, by posecal {record.version} (identify, approach "
        f"{record.approach}, method {record.method})",
    )
    heat = _temperatures(evidence, result)
    if heat is not None:
        yield "temperature while measuring", heat
    if record.rms_mm.nominal is not None:
        yield "as found (nominal model)", f"{mm(record.rms_mm.nominal)} RMS"
    left = record.rms_mm.heldout if record.held_out else record.rms_mm.fitted_all
    if left is not None:
        where = "poses that took no part" if record.held_out else "the fitted poses"
        yield "as left (identified model)", f"{mm(left)} RMS at {where}"
    if record.budget is not None:
        own = record.budget.total
        freedom = own.degrees_of_freedom
        behind = "" if freedom is None else f", {freedom:.0f} effective degrees of freedom"
        yield (
            "expanded uncertainty at the targets",
            f"{mm(own.expanded_mm)}, coverage factor {own.coverage_factor:.2f} for "
            f"{100.0 * record.budget.probability:.0f} %{behind}",
        )
    if record.acceptance is not None:
        verdict = (record.acceptance.verdict or "not judged").replace("_", " ")
        yield "conformity", f"{verdict}, tolerance {mm(record.acceptance.tolerance_mm)}"
        yield "decision rule", record.acceptance.stated
    if record.outliers:
        names = ", ".join(entry.pose for entry in record.outliers)
        yield "left out", f"poses {names}, as outliers"


def _temperatures(evidence: ReportEvidence, result: ReportedResult) -> str | None:
    measured = evidence.data.get(result.path)
    heat = None if measured is None else measured.data.poses.temperature
    if heat is None or not np.isfinite(heat).any():
        return None
    return f"{np.nanmin(heat):.1f} to {np.nanmax(heat):.1f} degC (column temperature_degC)"
