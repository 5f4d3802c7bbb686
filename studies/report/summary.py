"""The first screen of a page, and the fields of a calibration certificate as far as they are known.

The first screen is the verdict in a box, what to do next, how the error fell, and every headline. A
certificate's fields are those of ISO/IEC 17025:2017, 7.8.2 and 7.8.4. Whose certificate it is, nobody
can tell from figures: the page never says that it is one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup

from studies.command.session import day_of
from studies.diagnose.conclusion import to_do
from studies.diagnose.record import DiagnoseRecord
from studies.document import Raw, Section, Sentence, Table, heads, mm, plural
from studies.identify.record import IdentifyRecord
from studies.kinds import KINDS
from studies.noise import NoiseEntry
from studies.plots.style import short
from studies.record import BeforeAfter
from studies.report.evidence import ReportedResult, ReportEvidence

_BELOW = 2.0  # the scale begins at so much less than the least
_SHORTEST = 0.4  # percent


@dataclass(frozen=True)
class Bar:
    """A labelled length; look is "good", "bad" or "floor"."""

    label: str
    value: float
    look: str


def bars(entries: Sequence[Bar], caption: str) -> Raw:
    """A table whose last column draws each value on a log scale that a last row names."""
    values = [entry.value for entry in entries if entry.value > 0.0] or [1.0]
    low, high = min(values) / _BELOW, max(values)

    def along(value: float) -> float:
        if value <= low:
            return _SHORTEST
        return max(_SHORTEST, 100.0 * math.log(value / low) / math.log(high / low))

    lines = Markup("").join(
        Markup('<i style="left: {:.2f}%"></i>').format(along(entry.value))
        for entry in entries
        if entry.look == "floor"
    )
    rows = Markup("").join(
        Markup(
            '<tr><th scope="row">{}</th><td class="number">{}</td><td class="bar" aria-hidden="true">'
            '<span class="{}" style="width: {:.2f}%"></span>{}</td></tr>'
        ).format(e.label, f"{e.value:#.3g}".rstrip("."), e.look, along(e.value), lines)
        for e in entries
    )
    ticks = Markup("").join(
        Markup('<span style="left: {:.2f}%">{:g}</span>').format(along(tick), tick)
        for tick in _powers(low, high)
    )
    scale = Markup('<tfoot aria-hidden="true"><tr><td colspan="2"></td><td>{}</td></tr></tfoot>')
    return Raw(
        Markup('<table class="bars"><caption>{}</caption><tbody>{}</tbody>{}</table>').format(
            caption, rows, scale.format(ticks)
        )
    )


def _powers(low: float, high: float) -> list[float]:
    """Powers of ten between; those of five, too, where they are few.

    >>> _powers(0.008, 4.3), _powers(0.02, 0.09)
    ([0.01, 0.1, 1.0], [0.05])
    """
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found = [float(f"1e{decade}") for decade in decades]
    if high < 10.0 * low:
        found = [float(f"{step}e{decade}") for decade in decades for step in (1, 2, 5)]
    return [tick for tick in found if low < tick < high]


_MATTERS = ("identify", "compensate", "diagnose", "enough")
"""Kinds of results with an error before and after, what a reader asks for first."""
_KEYS: dict[str, tuple[str, ...]] = {
    "robot": ("robot", "model"),
    "serial number": ("serial",),
    "measured": ("measured", "date"),
    "operator": ("operator",),
}
"""What stands in the box, and the keys of [report] that tell it, the first that is there."""


def verdict(evidence: ReportEvidence, told: Mapping[str, str]) -> Raw | None:
    """Of the first result that holds an error before and after; None where none does.

    told : what the user tells of the measurement, by label; it outweighs the cell's [report]
    """
    for kind in _MATTERS:
        for result in evidence.of(kind):
            if result.record.error is not None:
                return _box(result.record.error, dict(_facts(evidence, result, told)))
    return None


def _box(found: BeforeAfter, facts: Mapping[str, str]) -> Raw:
    word, by = Markup(), Markup()
    look = "fell" if found.after < found.before else "fail"
    if (judged := found.judged) is not None:
        look = judged.outcome
        word = Markup("<p class=outcome>{}</p>").format(judged.word or judged.outcome.capitalize())
        by = Markup("<br>{}.").format(judged.by[:1].upper() + judged.by[1:])
    rows = Markup("").join(
        Markup("<div><dt>{}</dt><dd>{}</dd></div>").format(label, text)
        for label, text in facts.items()
    )
    was, now = (f"{short(value)} {found.unit}" for value in (found.before, found.after))
    return Raw(
        Markup(
            '<div class="verdict {}">{}<p class=fell><span class=visually-hidden>from </span>'
            "<span class=was>{}</span> <span aria-hidden=true>\N{RIGHTWARDS ARROW}</span> "
            "<span class=visually-hidden>to </span><strong>{}</strong></p>"
            "<p class=of>{}, {} \N{RIGHTWARDS ARROW} {}.{}</p><dl class=facts>{}</dl></div>"
        ).format(look, word, was, now, found.name, *found.ends, by, rows)
    )


def _facts(
    evidence: ReportEvidence, result: ReportedResult, told: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    about = {**result.record.about, **told}
    for label, keys in _KEYS.items():
        text = next((about[key] for key in keys if key in about), "")
        if label == "robot" and not text:
            text = result.record.cell
        if label == "measured" and not text:
            tables = evidence.data.get(result.path)
            text = "" if tables is None else day_of(tables.data.poses) or ""
        if text:
            yield label, text


_FIRST = ("identify", "diagnose")  # what a reader asks for before the rest


def summary(evidence: ReportEvidence, told: Mapping[str, str]) -> Section:
    """The verdict, what to do next, how the error fell, and the headline of each result.

    told : what the user tells of the measurement, by label
    """
    said = [line for kind in dict.fromkeys((*_FIRST, *KINDS)) for line in _said(evidence.of(kind))]
    records = _records(evidence)
    held = all(own.error.heldout for own in records if own is not None)
    drawn = list(_bars(*records, held))
    where = "held-out poses, which took no part in the fit" if held else "the fitted poses"
    caption = (
        f"RMS distance between measured and predicted points at {where} [mm], on a logarithmic scale. "
        "The dashed line is the noise of the instrument alone."
    )
    fall = [bars(drawn, caption)] if drawn else []
    mixed = [Sentence(note, "warn") for note in evidence.mixed]
    box = verdict(evidence, told)
    top = [] if box is None else [box]
    return Section("summary", "At a glance", (*mixed, *top, *_next(evidence), *fall, *said))


def _said(several: Sequence[ReportedResult]) -> Iterator[Sentence]:
    """The headlines of results of one kind, named by their files where there is more than one."""
    for own in several:
        label = own.path.name if len(several) > 1 else _LABELS.get(own.kind, own.kind)
        for number, line in enumerate(own.told.headline):
            yield replace(line, label="" if number else label)


_LABELS = {
    "design": "Plan",
    "plan": "What the plan shows",
    "compare": "Comparison",
    "identify": "Identification",
    "diagnose": "Diagnosis",
    "enough": "Enough poses?",
    "compensate": "Corrected commands",
    "changes": "What moved",
}


def _records(evidence: ReportEvidence) -> tuple[IdentifyRecord | None, DiagnoseRecord | None]:
    """What the bars are of: an identification and a diagnosis of the same data, in millimetres."""
    identified, diagnosed = evidence.record(IdentifyRecord), evidence.record(DiagnoseRecord)
    if identified is not None and diagnosed is not None:
        one, other = ({entry.sha256 for entry in own.inputs} for own in (identified, diagnosed))
        diagnosed = diagnosed if one <= other or other <= one else None
    if identified is not None and identified.rms_mm.nominal is None:
        identified = None  # no reading is a length
    if diagnosed is not None and diagnosed.gap.unit != "mm":
        diagnosed = None
    return identified, diagnosed


def _bars(
    identified: IdentifyRecord | None, diagnosed: DiagnoseRecord | None, held: bool
) -> Iterator[Bar]:
    """Errors from the nominal model to what the diagnosis leaves, and the noise, at the same poses."""
    noise: NoiseEntry | None = None
    if identified is not None:
        error = identified.error_at(heldout=held)
        yield Bar("before: nominal model", error.before, "bad")
        yield Bar("after: identified model", error.after, "good")
        noise = identified.noise
    if diagnosed is not None and diagnosed.effects:
        error = diagnosed.error_at(heldout=held)
        if identified is None:
            yield Bar("before: model as given", error.before, "bad")
        yield Bar("after: with the causes that the diagnosis found", error.after, "good")
        noise = diagnosed.noise
    if noise is not None:
        sigma = 3.0**0.5 * noise.believed_sigma_mm
        yield Bar("noise of the instrument alone, as stated", sigma, "floor")


def _next(evidence: ReportEvidence) -> Iterator[Sentence]:
    """What a reader should do with this."""
    diagnosed, identified = evidence.record(DiagnoseRecord), evidence.record(IdentifyRecord)
    after = to_do(diagnosed) if diagnosed is not None else ""
    if not after and identified is not None:
        after = _LACKS if identified.noise.lacks else _USE
    if not after and evidence.first("design") is not None:
        after = "measure the poses in their order, then posecal identify"
    if after:
        yield Sentence(f"What to do next: {after}.", "next")


_LACKS = "posecal diagnose says what the model lacks"
_USE = (
    "posecal compensate turns targets into corrected commands; posecal diagnose says whether anything "
    "is left"
)


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
    own = record.budget.total
    freedom = own.degrees_of_freedom
    behind = "" if freedom is None else f", {freedom:.0f} effective degrees of freedom"
    yield (
        "expanded uncertainty at the targets",
        f"{mm(own.expanded_mm)}, coverage factor {own.coverage_factor:.2f} for "
        f"{100.0 * record.budget.probability:.0f} %{behind}",
    )
    if record.acceptance is not None:
        verdict = record.acceptance.verdict or "not judged"
        yield "conformity", f"{verdict}, tolerance {mm(record.acceptance.tolerance_mm)}"
    if record.outliers:
        names = ", ".join(entry.pose for entry in record.outliers)
        yield "left out", f"poses {names}, as outliers"


def _temperatures(evidence: ReportEvidence, result: ReportedResult) -> str | None:
    measured = evidence.data.get(result.path)
    heat = None if measured is None else measured.data.poses.temperature
    if heat is None or not np.isfinite(heat).any():
        return None
    return f"{np.nanmin(heat):.1f} to {np.nanmax(heat):.1f} degC (column temperature_degC)"
