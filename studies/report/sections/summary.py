"""The first screen: what was found, in words, for a reader who knows robots but not statistics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from studies.diagnose.conclusion import to_do
from studies.diagnose.record import DiagnoseRecord
from studies.document import Section, Sentence
from studies.identify.record import IdentifyRecord
from studies.kinds import KINDS
from studies.noise import NoiseEntry
from studies.report.bars import Bar, bars
from studies.report.evidence import Evidence, Result
from studies.report.verdict import verdict

_FIRST = ("fleet", "prior", "identify", "diagnose")  # what a reader asks for before the rest


def summary(evidence: Evidence, told: Mapping[str, str]) -> Section:
    """The verdict, what to do next, how the error fell, and the headline of each result.

    told : what the user tells of the measurement, by label
    """
    said = [line for kind in dict.fromkeys((*_FIRST, *KINDS)) for line in _said(evidence.of(kind))]
    drawn = list(_bars(evidence))
    fall = [bars(drawn, _caption(evidence))] if drawn else []
    mixed = [Sentence(note, "warn") for note in evidence.mixed]
    box = verdict(evidence, told)
    top = [] if box is None else [box]
    return Section("summary", "At a glance", (*mixed, *top, *_next(evidence), *fall, *said))


def _said(several: Sequence[Result]) -> Iterator[Sentence]:
    """The headlines of results of one kind, named by their files where there is more than one."""
    for own in several:
        label = own.path.name if len(several) > 1 else _LABELS.get(own.kind, own.kind)
        for number, line in enumerate(own.told.headline):
            yield replace(line, label="" if number else label)


_LABELS = {
    "fleet": "All robots",
    "prior": "The type",
    "design": "Plan",
    "plan": "What the plan shows",
    "compare": "Comparison",
    "identify": "Identification",
    "diagnose": "Diagnosis",
    "enough": "Enough poses?",
    "next": "Next poses",
    "compensate": "Corrected commands",
    "iso9283": "ISO 9283",
    "changes": "What moved",
}


def _caption(evidence: Evidence) -> str:
    """Of the bars: where the errors are, and what the line is."""
    where = (
        "held-out poses, which took no part in the fit" if _held(evidence) else "the fitted poses"
    )
    return (
        f"RMS distance between measured and predicted points at {where} [mm], on a logarithmic scale. "
        "The dashed line is the noise of the instrument alone."
    )


def _held(evidence: Evidence) -> bool:
    """Whether every result with bars has held-out poses, so that they can be compared there."""
    identified, diagnosed = _records(evidence)
    return all(
        [
            identified is None or identified.nominal_at_heldout_mm is not None,
            diagnosed is None or diagnosed.gap.heldout_after_mm is not None,
            identified is not None or diagnosed is not None,
        ]
    )


def _records(evidence: Evidence) -> tuple[IdentifyRecord | None, DiagnoseRecord | None]:
    """What the bars are of: an identification and a diagnosis of the same data, in millimetres."""
    first, second = evidence.first("identify"), evidence.first("diagnose")
    identified = None if first is None else first.record
    diagnosed = None if second is None else second.record
    if first is not None and second is not None and not _same_data(first, second):
        diagnosed = None
    if not isinstance(identified, IdentifyRecord) or identified.rms_mm.nominal is None:
        identified = None
    if not isinstance(diagnosed, DiagnoseRecord) or diagnosed.gap.unit != "mm":
        diagnosed = None
    return identified, diagnosed


def _bars(evidence: Evidence) -> Iterator[Bar]:
    """Errors from the nominal model to what the diagnosis leaves, and the noise, at the same poses."""
    identified, diagnosed = _records(evidence)
    held = _held(evidence)
    noise: NoiseEntry | None = None
    if identified is not None:
        rms = identified.rms_mm
        before = identified.nominal_at_heldout_mm if held else rms.nominal
        after = rms.heldout if held else rms.fitted_all
        if before is None or after is None:
            return
        yield Bar("before: nominal model", before, "bad")
        yield Bar("after: identified model", after, "good")
        noise = identified.noise
    if diagnosed is not None and diagnosed.effects:
        gap = diagnosed.gap
        before = gap.heldout_before_mm if held else gap.fit_before_mm
        after = gap.heldout_after_mm if held else gap.fit_after_mm
        if identified is None and before is not None:
            yield Bar("before: model as given", before, "bad")
        if after is not None:
            yield Bar("after: with the causes that the diagnosis found", after, "good")
        noise = diagnosed.noise
    if noise is not None:
        sigma = 3.0**0.5 * noise.believed_sigma_mm
        yield Bar("noise of the instrument alone, as stated", sigma, "floor")


def _same_data(first: Result, second: Result) -> bool:
    """Whether two results are of the same cell, robot and table."""
    inputs = [{entry.sha256 for entry in result.inputs} for result in (first, second)]
    return inputs[0] <= inputs[1] or inputs[1] <= inputs[0]


def _next(evidence: Evidence) -> Iterator[Sentence]:
    """What a reader should do with this."""
    diagnosed, identified = (
        None if own is None else own.record
        for own in (evidence.first("diagnose"), evidence.first("identify"))
    )
    after = to_do(diagnosed) if isinstance(diagnosed, DiagnoseRecord) else ""
    if not after and isinstance(identified, IdentifyRecord):
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
