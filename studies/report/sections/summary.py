"""The first screen: what was found, in words, for a reader who knows robots but not statistics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from studies.diagnose.tables import loud, unfollowed, verdict_sentence
from studies.identify.common import shared_sentence
from studies.noise_words import UNFOLLOWED, lacks, noise_words, scatters
from studies.report.bars import Bar, bars
from studies.report.evidence import Evidence, Result
from studies.report.parts import Section, Text, listed
from studies.report.sections.approaches import points_of
from studies.report.sections.plan import certificate, size


def summary(evidence: Evidence) -> Section:
    """A headline of each result, how the error fell, and what to do next."""
    said = [
        line
        for kind, says in _SAYS.items()
        for result in evidence.of(kind)
        for line in says(result.fields)
    ]
    drawn = list(_bars(evidence))
    fall = [bars(drawn, _FALL)] if drawn else []
    mixed = [Text(note, "warn") for note in evidence.mixed]
    return Section("summary", "In one look", (*mixed, *said, *fall, *_next(evidence)))


_FALL = (
    "Distance between measured and predicted points, RMS [mm]. At the poses of the fit it may lie "
    "below the noise, of which the parameters take up a part; poses never seen show what "
    "holds elsewhere."
)


def _bars(evidence: Evidence) -> Iterator[Bar]:
    """Errors from the nominal model to what the diagnosis leaves, and the noise."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    noise = None
    if identified is not None:
        rms = identified.fields["rms_mm"]
        yield Bar("nominal model", rms["nominal"], "bad")
        yield Bar("identified model", rms["fitted_all"], "good")
        if rms["heldout"] is not None:
            yield Bar("identified model, at poses it never saw", rms["heldout"], "good")
        noise = 3.0**0.5 * identified.fields["noise"]["believed_sigma_mm"]
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


def _next(evidence: Evidence) -> Iterator[Text]:
    """What a reader should do with this."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    if diagnosed is not None and not loud(diagnosed.fields["noise"]):
        places = diagnosed.fields["located"]
        fine = bool(places) and all(map(unfollowed, places))
        after = f"{UNFOLLOWED}." if fine else _AFTER[diagnosed.fields["verdict"]]
        yield Text(f"What to do next: {after}", "next")
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


_AFTER = {
    "no_gap": "nothing is missing that these data could show; posecal compensate uses the model.",
    "explained": "put the found effects into the model (posecal diagnose --cell-out) and identify "
    "again; posecal compensate then uses them.",
    "ambiguous": "posecal diagnose --next chooses poses that tell the causes apart.",
    "unknown": "look at the arm where the gap sits; what is there is in no catalogue.",
}


def _identify(fields: Mapping[str, Any]) -> Iterator[Text]:
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
        praised = status != "not_converged" and before >= 2.0 * after > 0.0
        better = f", {before / after:.0f} times better" if praised else ""
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


def _diagnose(fields: Mapping[str, Any]) -> Iterator[Text]:
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


def _design(fields: Mapping[str, Any]) -> Iterator[Text]:
    yield Text(
        f"The plan has {size(fields)}, for {len(fields['predicted_std'])} parameters, chosen by "
        f"criterion {fields['criterion']}. {certificate(fields)} Expected after measuring: "
        f"{_mm(fields['task_rms_mm'])}.",
        "good",
    )


def _plan(fields: Mapping[str, Any]) -> Iterator[Text]:
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


def _compare(fields: Mapping[str, Any]) -> Iterator[Text]:
    best = {plan["plan"]: points_of(plan)["task_rms_mm"] for plan in fields["plans"]}
    said = "; ".join(f"{name} {_mm(rms)}" for name, rms in best.items())
    agreement = fields["agreement"]
    yield Text(
        f"Expected with approach #2: {said}. Checked with {fields['trials']} simulated experiments: "
        f"{agreement['says']}.",
        "warn" if agreement["believed"] is False else "good",
    )


def _mm(value: float | None) -> str:
    return "open" if value is None else f"{value:.4f} mm RMS"


def _enough(fields: Mapping[str, Any]) -> Iterator[Text]:
    plan = fields["plan"]
    now, end = (_mm(fields[key]["task_rms_mm"]) for key in ("now", "end"))
    if plan["poses"]:
        yield Text(
            f"{plan['measured']} of {plan['poses']} planned poses are measured; expected now {now}, at "
            f"the end {end}."
        )
    else:
        yield Text(f"Expected after the {fields['now']['readings']} readings so far: {now}.")


def _compensate(fields: Mapping[str, Any]) -> Iterator[Text]:
    rms = fields["rms_mm"]
    yield Text(
        f"Nominal commands miss {len(fields['targets'])} targets by {_mm(rms['before'])}; corrected "
        f"ones are expected to miss them by {_mm(rms['expected'])}.",
        "good" if rms["expected"] < rms["before"] else "warn",
    )


_SAYS = {
    "identify": _identify,
    "diagnose": _diagnose,
    "design": _design,
    "plan": _plan,
    "compare": _compare,
    "enough": _enough,
    "compensate": _compensate,
}
