"""A diagnosis as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from studies.tables import number, plain_table

_WORDS = {
    "no_gap": "no gap beyond noise",
    "explained": "the gap is explained",
    "ambiguous": "the gap is explained by one of several causes that these data cannot tell apart",
    "unknown": "there is a gap whose cause is not in the catalogue",
}
_MOST_HIDDEN = 12


def diagnosis_tables(name: str, fields: dict[str, Any]) -> Iterator[RenderableType]:
    """The verdict, the causes, the errors before and after, and what could not be seen."""
    noise = fields["noise"]
    yield Text(
        f"{name}: {_WORDS[fields['verdict']]}\n"
        f"noise      {noise['sigma_mm']:.4f} mm in each coordinate (stated "
        f"{noise['believed_sigma_mm']:.4f}, from {noise['source']})"
    )
    if fields["effects"]:
        yield Text("")
        yield _causes(fields["effects"])
    if fields["located"]:
        yield Text("")
        yield _located(fields["located"])
    yield Text("")
    yield _gap(fields["gap"])
    for entry in fields["outliers"]:
        yield Text(f"outlier  {entry['pose']}: {entry['reason']}")
    for entry in fields["not_asked"]:
        yield Text(f"not asked  {entry['reason']}")
    yield from _hidden(fields["could_not_see"])


def _causes(effects: list[dict[str, Any]]) -> Table:
    table = plain_table(
        ("\ncause", "left"), ("\nparameter", "left"), ("\nvalue", "right"),
        ("standard\ndeviation", "right"), ("\nunit", "left"), ("\nprobability", "right"),
    )  # fmt: skip
    for effect in effects:
        head = f"{effect['effect']}:{effect['where']}"
        shown = f"{effect['probability']:.2f}"
        for p in effect["parameters"]:
            table.add_row(head, p["name"], number(p["value"]), number(p["std"]), p["unit"], shown)
            head = shown = ""
        for other in effect["class"][1:]:
            alike = f"  or {other['effect']}:{other['where']}"
            table.add_row(alike, "", "", "", "", f"{other['probability']:.2f}")
    return table


def _located(places: list[dict[str, Any]]) -> Table:
    table = plain_table(("where", "left"), ("depends on", "left"), ("share of the gap", "right"))
    for place in places:
        share = place["share_of_gap"]
        table.add_row(
            place["where"], place["depends_on"], "-" if share != share else f"{100.0 * share:.0f} %"
        )
    return table


def _gap(gap: dict[str, Any]) -> Table:
    table = plain_table(
        ("RMS [mm]", "left"), ("before", "right"), ("after", "right"), ("floor", "right")
    )
    for label, key in (("fitted", "fit"), ("held out", "heldout")):
        before, after = gap[f"{key}_before_mm"], gap[f"{key}_after_mm"]
        if before is not None:
            table.add_row(label, f"{before:.4f}", f"{after:.4f}", f"{gap['floor_mm']:.4f}")
    if gap["closed"] is not None and gap["closed_ci95"] is not None:
        low, high = gap["closed_ci95"]
        table.add_row(f"closed {100 * gap['closed']:.0f} % ({100 * low:.0f} to {100 * high:.0f})")
    return table


def _hidden(entries: list[dict[str, Any]]) -> Iterator[RenderableType]:
    unseen = [f"{e['effect']}:{e['where']}" for e in entries if e["minimum_detectable"] is None]
    if unseen:
        more = f" and {len(unseen) - _MOST_HIDDEN} more" if len(unseen) > _MOST_HIDDEN else ""
        yield Text(f"\nnot visible at these poses: {', '.join(unseen[:_MOST_HIDDEN])}{more}")
    yield Text("smallest sizes that would have been found: JSON, could_not_see")
