"""The first screen: what was found, in words, for a reader who knows robots but not statistics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from studies.diagnose.record import DiagnoseRecord
from studies.diagnose.telling import to_do
from studies.document import Sentence
from studies.identify.common import shared_sentence
from studies.noise_words import lacks, noise_words, scatters
from studies.report.bars import Bar, bars
from studies.report.evidence import KINDS, Evidence, Result, faults_of
from studies.report.parts import Section, Text, listed
from studies.report.sections.plan import certificate, size


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
    identified, result = evidence.first("identify"), evidence.first("diagnose")
    noise = None
    if identified is not None:
        rms = identified.fields["rms_mm"]
        yield Bar("nominal model", rms["nominal"], "bad")
        yield Bar("identified model", rms["fitted_all"], "good")
        if rms["heldout"] is not None:
            yield Bar("identified model, at poses it never saw", rms["heldout"], "good")
        noise = 3.0**0.5 * identified.fields["noise"]["believed_sigma_mm"]
    if result is not None and (identified is None or _same_data(identified, result)):
        diagnosed = result.record
        if isinstance(diagnosed, DiagnoseRecord) and diagnosed.effects:
            label = "with what the diagnosis found"
            yield Bar(label, diagnosed.gap.fit_after_mm, "good")
            if diagnosed.gap.heldout_after_mm is not None:
                held = diagnosed.gap.heldout_after_mm
                yield Bar(f"{label}, at poses it never saw", held, "good")
            noise = 3.0**0.5 * diagnosed.noise.believed_sigma_mm
    if noise is not None:
        yield Bar("the instrument's noise alone, as stated", noise, "floor")


def _same_data(first: Result, second: Result) -> bool:
    """Whether two results are of the same cell, robot and table."""
    inputs = [{entry.sha256 for entry in result.inputs} for result in (first, second)]
    return inputs[0] <= inputs[1] or inputs[1] <= inputs[0]


def _next(evidence: Evidence) -> Iterator[Sentence]:
    """What a reader should do with this."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    found = None if diagnosed is None else diagnosed.record
    after = to_do(found) if isinstance(found, DiagnoseRecord) else ""
    if after:
        yield Text(f"What to do next: {after}.", "next")
    elif identified is not None and lacks(identified.fields["noise"]):
        yield Text("What to do next: posecal diagnose says what the model lacks.", "next")
    elif identified is not None:
        yield Text(
            "What to do next: posecal compensate turns targets into corrected commands; "
            "posecal diagnose says whether anything is left.",
            "next",
        )
    elif evidence.first("design") is not None:
        yield Text(
            "What to do next: measure the poses in their order, then posecal identify.", "next"
        )


def _identify(fields: Mapping[str, Any]) -> Iterator[Sentence]:
    rms, status = fields["rms_mm"], fields["status"]
    found = (
        f"{fields['rank']} of {len(fields['parameters'])} parameters identified from {fields['poses']} "
        f"readings, {fields['points']} points"
    )
    before, after, where = rms["nominal"], rms["fitted_all"], ""
    if rms["heldout"] is not None:
        before, after, where = _unseen(fields), rms["heldout"], "at poses it never saw, "
    good = status == "converged" and after < before
    if after < before:
        better = f", {before / after:.0f} times better" if before >= 2.0 * after > 0.0 else ""
        said = f"off by {before:.3f} mm and is now predicted to {after:.3f} mm{better}"
    else:
        said = f"off by {before:.3f} mm and is predicted to {after:.3f} mm, which is no better"
    sentence = f"{where}the robot was {said}: {found}."
    yield Text(sentence[0].upper() + sentence[1:], "good" if good else "warn")
    if after >= before:
        yield Text(
            "Do not use the identified model: measure more poses, or identify fewer parameters.",
            "warn",
        )
    if status != "converged":
        name = status.replace("_", " ")
        yield Text(f"{name[0].upper()}{name[1:]}: {fields['advice']}.", "warn")
    yield Text(
        f"The uncertainty of the parameters leaves {fields['task_rms_mm']:.3f} mm at other poses, "
        f"{fields['task_worst_mm']:.3f} mm at worst; what the model lacks comes on top."
    )
    noise = fields["noise"]
    if scatters(noise):
        yield Text(f"Noise: {'; '.join(noise_words(noise))}.")
    elif noise["source"] == "residual":
        yield Text(
            f"The points scatter by {noise['sigma_mm']:.4f} mm in each coordinate where the instrument "
            f"should by {noise['believed_sigma_mm']:.4f} mm: the model lacks something, or the noise "
            "is not as stated.",
            "warn",
        )
    if fields["outliers"]:
        names = [entry["pose"] for entry in fields["outliers"]]
        yield Text(f"Left out of the fit as outliers: {listed(names)}.", "warn")
    if fields.get("outliers_share"):
        yield Text(shared_sentence(fields["outliers_share"]), "warn")


def _unseen(fields: Mapping[str, Any]) -> float:
    """RMS of the nominal model at the held-out points, mm."""
    squares = [
        sum(float(x) ** 2 for x in row["nominal_mm"])
        for row in fields["residuals"]
        if row["heldout"]
    ]
    return float((sum(squares) / len(squares)) ** 0.5)


def _design(fields: Mapping[str, Any]) -> Iterator[Sentence]:
    yield Text(
        f"The plan has {size(fields)}, for {len(fields['predicted_std'])} parameters, chosen by "
        f"criterion {fields['criterion']}. {certificate(fields)} Expected after measuring: "
        f"{_mm(fields['task_rms_mm'])}.",
        "good",
    )


def _mm(value: float | None) -> str:
    return "open" if value is None else f"{value:.4f} mm RMS"


_SAYS = {
    "identify": _identify,
    "design": _design,
}
