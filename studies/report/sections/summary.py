"""The first screen: what was found, in words, for a reader who knows robots but not statistics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from studies.diagnose.conclusion import to_do
from studies.diagnose.record import DiagnoseRecord
from studies.document import Section, Sentence
from studies.identify.record import IdentifyRecord
from studies.kinds import KINDS
from studies.noise import Noise
from studies.report.bars import Bar, bars
from studies.report.evidence import Evidence, Result

_FIRST = ("fleet", "prior", "identify", "diagnose")  # what a reader asks for before the rest


def summary(evidence: Evidence) -> Section:
    """A headline of each result, how the error fell, and what to do next."""
    said = [line for kind in dict.fromkeys((*_FIRST, *KINDS)) for line in _said(evidence.of(kind))]
    drawn = list(_bars(evidence))
    fall = [bars(drawn, _FALL)] if drawn else []
    mixed = [Sentence(note, "warn") for note in evidence.mixed]
    return Section("summary", "In one look", (*mixed, *said, *fall, *_next(evidence)))


def _said(several: Sequence[Result]) -> Iterator[Sentence]:
    """The headlines of results of one kind, named by their files where there is more than one."""
    for own in several:
        for number, line in enumerate(own.told.headline):
            named = f"{own.path.name}: " if len(several) > 1 and not number else ""
            yield replace(line, text=f"{named}{line.text}")


_FALL = (
    "Distance between measured and predicted points, RMS [mm]. At the poses of the fit it may lie "
    "below the noise, of which the parameters take up a part; poses never seen show what "
    "holds elsewhere. The scale is logarithmic; the dashed line is the noise."
)


def _bars(evidence: Evidence) -> Iterator[Bar]:
    """Errors from the nominal model to what the diagnosis leaves, and the noise."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    noise: Noise | None = None
    if identified is not None and isinstance(identified.record, IdentifyRecord):
        rms = identified.record.rms_mm
        if rms.nominal is None or rms.fitted_all is None:
            return  # no reading is a length
        yield Bar("nominal model", rms.nominal, "bad")
        yield Bar("identified model", rms.fitted_all, "good")
        if rms.heldout is not None:
            yield Bar("identified model, at poses it never saw", rms.heldout, "good")
        noise = identified.record.noise
    if diagnosed is not None and (identified is None or _same_data(identified, diagnosed)):
        found = diagnosed.record
        if isinstance(found, DiagnoseRecord) and found.gap.unit != "mm":
            return
        if isinstance(found, DiagnoseRecord) and found.effects:
            label, held = "with what the diagnosis found", found.gap.heldout_after_mm
            yield Bar(label, found.gap.fit_after_mm, "good")
            if held is not None:
                yield Bar(f"{label}, at poses it never saw", held, "good")
            noise = found.noise
    if noise is not None:
        sigma = 3.0**0.5 * noise.believed_sigma_mm
        yield Bar("the instrument's noise alone, as stated", sigma, "floor")


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
