"""The first screen: what was found, in words, for a reader who knows robots but not statistics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies.diagnose.tables import verdict_sentence
from studies.report.evidence import Evidence
from studies.report.parts import Section, Text, listed, shown
from studies.report.bars import Bar, bars

_FAR = 1.5  # times the noise from which on an error is more than noise


def summary(evidence: Evidence) -> Section:
    """Headlines of every kind of result there is, and how the error fell."""
    parts: list[Any] = []
    lines: list[Text] = []
    for result in evidence.results:
        lines += _SAYS[result.kind](result.fields)
    shown_bars = list(_bars(evidence))
    if shown_bars:
        parts.append(bars(shown_bars, "RMS distance between measured and predicted points [mm]"))
    return Section("summary", "In one look", (*lines, *parts))


def _bars(evidence: Evidence) -> Iterator[Bar]:
    """Errors from the nominal model to what the diagnosis leaves, and the noise."""
    identified, diagnosed = evidence.first("identify"), evidence.first("diagnose")
    noise = None
    if identified is not None:
        rms = identified.fields["rms_mm"]
        yield Bar("nominal model", rms["nominal"], "bad")
        yield Bar("identified model, poses it was fitted to", rms["fitted_all"], "good")
        if rms["heldout"] is not None:
            yield Bar("identified model, poses it never saw", rms["heldout"], "good")
        noise = identified.fields["noise"]["sigma_mm"] * 3.0**0.5
    if diagnosed is not None and diagnosed.fields["effects"]:
        gap = diagnosed.fields["gap"]
        held = gap["heldout_after_mm"] is not None
        value = gap["heldout_after_mm"] if held else gap["fit_after_mm"]
        yield Bar(
            f"with the diagnosed effects{', poses never seen' if held else ''}", value, "good"
        )
        noise = gap["floor_mm"]
    if noise is not None:
        yield Bar("instrument's noise alone", noise, "floor")


def _identify(fields: dict[str, Any]) -> Iterator[Text]:
    rms, noise = fields["rms_mm"], fields["noise"]["sigma_mm"]
    factor = rms["nominal"] / rms["fitted_all"] if rms["fitted_all"] else None
    yield Text(
        f"The robot was off by {shown(rms['nominal'])} mm and is now predicted to "
        f"{shown(rms['fitted_all'])} mm"
        + (f", {factor:.0f} times better" if factor and factor >= 2.0 else "")
        + f": {fields['rank']} of {len(fields['parameters'])} parameters identified from "
        f"{fields['poses']} readings, {fields['points']} points.",
        "good" if fields["status"] == "converged" else "warn",
    )
    if fields["status"] != "converged":
        yield Text(f"{fields['status'].replace('_', ' ')}: {fields['advice']}.", "warn")
    yield Text(
        f"At any pose expect {shown(fields['task_rms_mm'])} mm RMS and {shown(fields['task_worst_mm'])} "
        f"mm at worst from the uncertainty of the parameters ({fields['targets']}); what the model "
        "lacks comes on top."
    )
    if fields["noise"]["source"] == "residual":
        yield Text(
            f"The points scatter by {shown(noise)} mm in each coordinate where the cell states "
            f"{shown(fields['noise']['believed_sigma_mm'])} mm: the model lacks something, or the noise "
            "is not as stated. posecal diagnose asks which.",
            "warn",
        )
    if fields["outliers"]:
        names = [entry["pose"] for entry in fields["outliers"]]
        yield Text(f"Left out of the fit as outliers: {listed(names)}.", "warn")


def _design(fields: dict[str, Any]) -> Iterator[Text]:
    proved = fields["proof"]["proved_optimal"]
    share = 100.0 * fields["efficiency"]
    yield Text(
        f"{len(fields['poses'])} poses are planned for {len(fields['predicted_std'])} parameters: "
        + (
            "no better plan exists"
            if proved
            else f"no plan can be more than {100 - share:.1f} % better"
        )
        + f" by criterion {fields['criterion']}, among {fields['candidates']['feasible']} candidates. "
        f"Expected after measuring: {shown(fields['task_rms_mm'])} mm RMS.",
        "good",
    )


def _compare(fields: dict[str, Any]) -> Iterator[Text]:
    agreement = fields["agreement"]
    plans = [(plan, _points(plan)) for plan in fields["plans"]]
    plan, best = min(plans, key=lambda pair: pair[1]["task_rms_mm"] or float("inf"))
    yield Text(
        f"Best of {len(plans)} plan{'s' * (len(plans) > 1)}: {plan['plan']}, {shown(best['task_rms_mm'])} mm RMS "
        f"expected with approach #2. Checked with {fields['trials']} simulated experiments: "
        f"{agreement['says']}.",
        "warn" if agreement["believed"] is False else "good",
    )


def _points(plan: dict[str, Any]) -> dict[str, Any]:
    return next(a for a in plan["approaches"] if a["approach"] == "points")


def _diagnose(fields: dict[str, Any]) -> Iterator[Text]:
    sentence = verdict_sentence(fields)
    kind = "good" if fields["verdict"] in ("no_gap", "explained") else "warn"
    closed = fields["gap"]["closed"]
    yield Text(
        f"{sentence[0].upper()}{sentence[1:]}."
        + (
            f" {100.0 * closed:.0f} % of the gap is closed on poses that the choice never saw."
            if closed and fields["effects"]
            else ""
        ),
        kind,
    )


def _plan(fields: dict[str, Any]) -> Iterator[Text]:
    seen = [e for e in fields["could_not_see"] if e["minimum_detectable"] is not None]
    yield Text(
        f"Of {len(fields['could_not_see'])} causes that a gap may have, this plan could find "
        f"{len(seen)}; {len(fields['twins'])} groups would stand for each other at any size."
    )


def _compensate(fields: dict[str, Any]) -> Iterator[Text]:
    yield Text("Corrected joint commands were computed; see below.")


def _enough(fields: dict[str, Any]) -> Iterator[Text]:
    yield Text("What further poses would still bring stands below.")


_SAYS = {
    "identify": _identify,
    "design": _design,
    "compare": _compare,
    "diagnose": _diagnose,
    "plan": _plan,
    "compensate": _compensate,
    "enough": _enough,
}
