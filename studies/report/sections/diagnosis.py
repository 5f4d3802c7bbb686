"""The diagnosis: where the gap lies, what causes it, how far it shrinks, what to measure next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies.diagnose.aliasing import aliasing_sentences
from studies.diagnose.pictures import pictures
from studies.diagnose.tables import loud, percent, refused_rows, unfollowed, verdict_sentence
from studies.noise_words import UNFOLLOWED, noise_words
from studies.report.evidence import Evidence, Result
from studies.report.parts import Figure, Part, Section, Table, Text, folded, joint_columns, shown

_MEANS = {
    "no_gap": "The measurements show nothing beyond the model and the noise.",
    "explained": "Each cause is named, and nothing is left to explain.",
    "ambiguous": "Nothing is left to explain, but other causes or forms would do as well.",
    "unknown": "Something is there that no cause in the catalogue does.",
}


def diagnosis(evidence: Evidence, result: Result) -> Section:
    """Verdict, causes, the fall of the error, places, and what stayed unseen."""
    return Section("diagnosis", "Where the gap comes from", tuple(_parts(result.fields)))


def _parts(fields: dict[str, Any]) -> Iterator[Part]:
    sentence = verdict_sentence(fields)
    good = fields["verdict"] in ("no_gap", "explained") and not loud(fields["noise"])
    yield Text(
        f"{sentence[0].upper()}{sentence[1:]}. {_MEANS[fields['verdict']]}",
        "good" if good else "warn",
    )
    yield Text(f"Noise: {'; '.join(noise_words(fields['noise']))}.")
    yield _gap(fields["gap"])
    if fields["effects"]:
        yield _causes(fields["effects"])
    drawn = list(pictures(fields)) if fields["effects"] or fields["located"] else []
    for picture in drawn:
        yield Figure(picture)
    for sentence in aliasing_sentences(fields.get("spectra", ())):
        yield Text(f"{sentence}.", "note")
    if fields["located"]:
        yield Table(
            ("where", "depends on", "share of the gap"),
            [(p["where"], p["depends_on"], percent(p["share_of_gap"])) for p in fields["located"]],
            "Where the gap sits",
        )
        for place in filter(unfollowed, fields["located"]):
            yield Text(f"{place['where']} by pose: {UNFOLLOWED}.", "note")
    if fields.get("refused"):
        rows = refused_rows(fields["refused"])
        yield Table(("cause", "why"), rows, "Refused: found, and not named all the same",
                    fold=folded("Refused", rows))  # fmt: skip
    if fields["outliers"]:
        rows = [(entry["pose"], entry["reason"]) for entry in fields["outliers"]]
        yield Table(("pose", "reason"), rows, "Poses left out of the diagnosis", of_poses=True,
                    fold=folded("Poses left out of the diagnosis", rows))  # fmt: skip
    yield _unseen(fields["could_not_see"])
    if fields["not_asked"]:
        rows = [(entry["effect"], entry["reason"]) for entry in fields["not_asked"]]
        yield Table(("cause", "why"), rows, fold=f"Causes that could not be asked ({len(rows)})")


def _gap(gap: dict[str, Any]) -> Part:
    rows = [
        (label, gap[f"{key}_before_mm"], gap[f"{key}_after_mm"], gap["floor_mm"], _closed(gap, key))
        for label, key in (("fitted poses", "fit"), ("poses the choice never saw", "heldout"),
                           ("quarters of the session", "over_time"))
        if gap.get(f"{key}_before_mm") is not None
    ]  # fmt: skip
    return Table(
        ("RMS [mm]", "before", "after", "noise alone", "share of the gap that is closed"), rows
    )


def _closed(gap: dict[str, Any], key: str) -> str:
    if key != "heldout" or gap["closed"] is None:
        return ""
    between = gap["closed_ci95"]
    interval = "" if between is None else f" ({100 * between[0]:.0f} to {100 * between[1]:.0f} %)"
    return f"{percent(gap['closed'])}{interval}"


def _causes(effects: list[dict[str, Any]]) -> Part:
    rows = []
    for effect in effects:
        others = [f"{o['effect']}:{o['where']}" for o in effect["class"][1:]]
        for number, p in enumerate(effect["parameters"]):
            rows.append(
                (
                    f"{effect['effect']}:{effect['where']}" if not number else "",
                    shown(effect["probability"]) if not number else "",
                    percent(effect["share_of_gap"]) if not number else "",
                    p["name"],
                    p["value"],
                    "not determined" if p["std"] is None else p["std"],
                    p["unit"],
                    ", ".join(others) if not number else "",
                )
            )
    header = (
        "cause", "probability", "share of the gap", "parameter", "value", "\N{PLUS-MINUS SIGN} 1 std",
        "unit", "or",
    )  # fmt: skip
    return Table(header, rows, "What causes the gap", fold=folded("What causes the gap", rows))


def _unseen(entries: list[dict[str, Any]]) -> Part:
    rows = [
        (e["effect"], e["where"], "not visible" if e["minimum_detectable"] is None
         else shown(e["minimum_detectable"]), e["unit"])
        for e in entries
    ]  # fmt: skip
    return Table(
        ("cause", "where", "smallest size found nine times in ten", "unit"),
        rows,
        fold=f"What these data could not have shown ({len(rows)})",
    )


def further(evidence: Evidence, result: Result) -> Section | None:
    """Poses to measure next, with what they tell apart."""
    poses = result.fields["next_poses"]
    if not poses:
        return None
    joints = joint_columns(poses)
    rows = [
        (
            *(f"{pose[key][name]:.2f}" for _, key, name in joints),
            "; ".join(" from ".join(map(str, pair)) for pair in pose["splits"]),
        )
        for pose in poses
    ]
    header = (*(title for title, _, _ in joints), "tells apart")
    return Section(
        "next",
        "What to measure next",
        (
            Text("These poses tell apart the causes that the data so far leave open."),
            Table(header, rows, fold=folded("Poses", rows)),
            *(Text(line, "note") for line in result.fields.get("next_poses_assume", [])),
        ),
    )
