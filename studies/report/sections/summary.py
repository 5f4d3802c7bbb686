"""The first screen: what was found, in words, for a reader who knows robots but not statistics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from studies.diagnose.tables import loud, unfollowed, verdict_sentence
from studies.document import Sentence
from studies.identify.record import IdentifyRecord
from studies.noise_words import UNFOLLOWED
from studies.report.bars import Bar, bars
from studies.report.evidence import KINDS, Evidence, Result, faults_of
from studies.report.parts import Section, Text


def summary(evidence: Evidence) -> Section:
    """A headline of each result, how the error fell, and what to do next."""
    said = [line for kind in KINDS for result in evidence.of(kind) for line in _headline(result)]
    unchecked = [str(result.path) for result in evidence.results if result.record is None]
    with faults_of(unchecked[0] if len(unchecked) == 1 else f"one of {len(unchecked)} results"):
        drawn = list(_bars(evidence))
        after = list(_next(evidence))
    fall = [bars(drawn, _FALL)] if drawn else []
    mixed = [Text(note, "warn") for note in evidence.mixed]
    return Section("summary", "In one look", (*mixed, *said, *fall, *after))


def _headline(result: Result) -> Iterator[Sentence]:
    if result.told is not None:
        yield from result.told.headline
        return
    with faults_of(result.path):
        yield from _SAYS[result.kind](result.fields)


_FALL = (
    "Distance between measured and predicted points, RMS [mm]. At the poses of the fit it may lie "
    "below the noise, of which the parameters take up a part; poses never seen show what "
    "holds elsewhere."
)


def _bars(evidence: Evidence) -> Iterator[Bar]:
    """Errors from the nominal model to what the diagnosis leaves, and the noise."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    noise = None
    if identified is not None and isinstance(identified.record, IdentifyRecord):
        rms = identified.record.rms_mm
        yield Bar("nominal model", rms.nominal, "bad")
        yield Bar("identified model", rms.fitted_all, "good")
        if rms.heldout is not None:
            yield Bar("identified model, at poses it never saw", rms.heldout, "good")
        noise = 3.0**0.5 * identified.record.noise.believed_sigma_mm
    if identified is not None and diagnosed is not None and not _same_data(identified, diagnosed):
        diagnosed = None
    if diagnosed is not None and diagnosed.fields["effects"]:
        gap = diagnosed.fields["gap"]
        held = gap["heldout_after_mm"]
        label = "with what the diagnosis found"
        yield Bar(label, gap["fit_after_mm"], "good")
        if held is not None:
            yield Bar(f"{label}, at poses it never saw", held, "good")
        noise = 3.0**0.5 * diagnosed.fields["noise"]["believed_sigma_mm"]
    if noise is not None:
        yield Bar("the instrument's noise alone, as stated", noise, "floor")


def _same_data(first: Result, second: Result) -> bool:
    """Whether two results are of the same cell, robot and table."""
    inputs = [{entry.sha256 for entry in result.inputs} for result in (first, second)]
    return inputs[0] <= inputs[1] or inputs[1] <= inputs[0]


def _next(evidence: Evidence) -> Iterator[Sentence]:
    """What a reader should do with this."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    if diagnosed is not None and not loud(diagnosed.fields["noise"]):
        places = diagnosed.fields["located"]
        fine = bool(places) and all(map(unfollowed, places))
        after = f"{UNFOLLOWED}." if fine else _AFTER[diagnosed.fields["verdict"]]
        yield Text(f"What to do next: {after}", "next")
    elif identified is not None and isinstance(identified.record, IdentifyRecord):
        if identified.record.noise.lacks:
            yield Text("What to do next: posecal diagnose says what the model lacks.", "next")
            return
        yield Text(
            "What to do next: posecal compensate turns targets into corrected commands; "
            "posecal diagnose says whether anything is left.",
            "next",
        )
    elif evidence.first("design") is not None:
        yield Text(
            "What to do next: measure the poses in their order, then posecal identify.", "next"
        )


_AFTER = {
    "no_gap": "nothing is missing that these data could show; posecal compensate uses the model.",
    "explained": "put the found effects into the model (posecal diagnose --cell-out) and identify "
    "again; posecal compensate then uses them.",
    "ambiguous": "posecal diagnose --next chooses poses that tell the causes apart.",
    "unknown": "look at the arm where the gap sits; what is there is in no catalogue.",
}


def _diagnose(fields: Mapping[str, Any]) -> Iterator[Sentence]:
    sentence, closed = verdict_sentence(dict(fields)), fields["gap"]["closed"]
    good = fields["verdict"] in ("no_gap", "explained") and not loud(fields["noise"])
    proof = ""
    if closed is not None and fields["effects"]:
        proof = (
            f" At poses that the choice never saw, {100.0 * closed:.0f} % of the gap is gone."
            if closed > 0.0
            else " At poses that the choice never saw, the error did not shrink."
        )
    yield Text(f"{sentence[0].upper()}{sentence[1:]}.{proof}", "good" if good else "warn")


def _plan(fields: Mapping[str, Any]) -> Iterator[Sentence]:
    entries = fields["could_not_see"]
    seen = [entry for entry in entries if entry["minimum_detectable"] is not None]
    twins = len(fields["twins"])
    yield Text(
        f"Of {len(entries)} causes that a gap may have, the plan could find {len(seen)}"
        + (
            f"; {twins} group{'s' * (twins > 1)} of them would stand for each other."
            if twins
            else "."
        )
    )


def _mm(value: float | None) -> str:
    return "open" if value is None else f"{value:.4f} mm RMS"


_SAYS = {
    "diagnose": _diagnose,
    "plan": _plan,
}
