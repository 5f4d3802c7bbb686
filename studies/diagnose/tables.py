"""A diagnosis as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib.diagnosis.candidates import EXCLUDED
from studies.diagnose.aliasing import aliasing_sentences
from studies.diagnose.hidden import hidden_table
from studies.noise_words import UNFOLLOWED, noise_words
from studies.tables import number, plain_table

_MOST_PARAMETERS = 8  # of one cause; sag of a whole arm has fifty
_LOUD = 4.0  # times the stated noise that no instrument exceeds by itself
_MOST_OUTLIERS = 3  # that are worth a line each


def diagnosis_tables(name: str, fields: dict[str, Any]) -> Iterator[RenderableType]:
    """The verdict, the errors before and after, the causes, the places, and what stayed unseen."""
    noise = fields["noise"]
    yield Text(f"{name}: {verdict_sentence(fields)}", style="bold")
    first, *more = noise_words(noise)
    yield Text("\n".join([f"noise {first}", *more]) + "\n")
    yield _gap(fields["gap"])
    for effect in fields["effects"]:
        yield from _cause(effect)
    if fields["located"]:
        yield Text("")
        yield _located(fields["located"], fields["effects"])
        for place in filter(unfollowed, fields["located"]):
            yield Text(f"{place['where']} by pose: {UNFOLLOWED}")
    if fields.get("refused"):
        yield Text("\nRefused: found, and not named all the same")
        yield _refused(fields["refused"])
    for sentence in aliasing_sentences(fields.get("spectra", ())):
        yield Text(f"\n{sentence}")
    yield from _notes(fields)
    yield from hidden_table(fields["could_not_see"])


def loud(noise: dict[str, Any]) -> str:
    """What to suspect where the noise is far from what the cell states; empty where it is not."""
    factor = noise["sigma_mm"] / noise["believed_sigma_mm"]
    if factor < _LOUD:
        return ""
    return (
        f"but the noise is {factor:.0f} times what the cell states: see that every load is in the "
        "table, and sigma_mm"
    )


def verdict_sentence(fields: dict[str, Any]) -> str:
    """The verdict in words: what it is, or where it sits."""
    causes = _listed([" or ".join(map(_name, e["class"] or [e])) for e in fields["effects"]])
    verdict, places = fields["verdict"], fields["located"]
    if verdict == "no_gap":
        return "no gap beyond noise" + (loud(fields["noise"]) and f", {loud(fields['noise'])}")
    if verdict == "explained":
        return f"the gap is explained by {causes}"
    if verdict == "ambiguous":
        untested = [_name(e) for e in fields["effects"] if not e.get("shape_tested", True)]
        if not untested:
            return f"the gap is explained by {causes}; these data cannot tell which"
        return (
            f"the gap is explained by {causes}; these data cannot tell whether the size of "
            f"{_listed(untested)} varies with the joints' angles"
        )
    if fields["effects"]:
        return f"the gap is more than {causes}; the rest has no cause in the catalogue"
    if not places or (unfollowed(places[0]) and len(places) == 1):
        return _nowhere(fields)
    first = next(place for place in places if not unfollowed(place))
    return (
        f"a gap at {first['where']} that depends on {first['depends_on']}; "
        "no cause in the catalogue does the same"
    )


def unfollowed(place: dict[str, Any]) -> bool:
    """Whether it is what differs from pose to pose and follows no column."""
    return bool(place["depends_on"] == "pose")


def _nowhere(fields: dict[str, Any]) -> str:
    """The verdict where neither a name nor a column stands."""
    if fields.get("refused"):
        return "more is left than noise, and nothing that was tried predicts other poses better"
    if fields["located"]:
        where = fields["located"][0]["where"]
        who = "the arm" if where == "arm" else where
        return f"{who} errs from pose to pose as no cause in the catalogue and no column does"
    return "more is left than noise, and neither its place nor its cause was found"


def _refused(entries: list[dict[str, Any]]) -> Table:
    table = plain_table(("cause", "left"), ("why", "left"))
    for column in table.columns:
        column.overflow = "fold"
    for name, reason in refused_rows(entries):
        table.add_row(name, reason)
    return table


def refused_rows(entries: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Refused causes with reasons, those of one reason and kind in one line."""
    groups: dict[tuple[str, str], list[str]] = {}
    for e in entries:
        groups.setdefault((e["effect"], e["reason"]), []).append(e["where"])
    return [
        (f"{kind}:{shortened(list(dict.fromkeys(where)), 4)}", reason)
        for (kind, reason), where in groups.items()
    ]


def _listed(parts: list[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _name(effect: dict[str, Any]) -> str:
    return f"{effect['effect']}:{effect['where']}"


def percent(share: float | None) -> str:
    """A share as text, a dash where there is none."""
    return "-" if share is None else f"{100.0 * share:.0f} %"


def _gap(gap: dict[str, Any]) -> Table:
    table = plain_table(
        ("RMS [mm]", "left"), ("before", "right"), ("after", "right"), ("floor", "right"),
        ("gap closed (95 % interval)", "left"),
    )  # fmt: skip
    rows = (("fitted", "fit"), ("held out", "heldout"), ("quarters of the session", "over_time"))
    for label, key in rows:
        before, after = gap.get(f"{key}_before_mm"), gap.get(f"{key}_after_mm")
        if before is None:
            continue
        closed = _closed(gap) if key == "heldout" else ""
        table.add_row(label, *(f"{x:.4f}" for x in (before, after, gap["floor_mm"])), closed)
    return table


def _closed(gap: dict[str, Any]) -> str:
    if gap["closed"] is None:
        return "none was above the floor"
    if gap["closed_ci95"] is None or gap["heldout_before_mm"] == gap["heldout_after_mm"]:
        return percent(gap["closed"])
    low, high = gap["closed_ci95"]
    return f"{percent(gap['closed'])} ({100.0 * low:.0f} to {100.0 * high:.0f})"


def _cause(effect: dict[str, Any]) -> Iterator[RenderableType]:
    """A line of its own for the name, which may be long, and the parameters below it."""
    yield Text(
        f"\n{_name(effect)}, probability {_two_digits(effect['probability'])}, "
        f"{percent(effect['share_of_gap'])} of the gap"
    )
    for other in effect["class"][1:]:
        yield Text(f"  or {_name(other)}, probability {_two_digits(other['probability'])}")
    known = [p for p in effect["parameters"] if p["std"] is not None]
    unknown = [p["name"] for p in effect["parameters"] if p["std"] is None]
    largest = sorted(known, key=lambda p: -_significance(p))[:_MOST_PARAMETERS]
    table = plain_table(
        ("  parameter", "left"), ("value", "right"), ("standard deviation", "right"), ("unit", "left")
    )  # fmt: skip
    for p in known:
        if p in largest:
            table.add_row(f"  {p['name']}", number(p["value"]), number(p["std"]), p["unit"])
    if len(unknown) <= 2:
        for name in unknown:
            table.add_row(f"  {name}", "-", "not identified", "")
    yield table
    if len(known) > len(largest):
        yield Text(f"  and {len(known) - len(largest)} that differ less from zero (JSON)")
    if len(unknown) > 2:
        yield Text(f"  not identified at these poses: {shortened(unknown, 4)}")


def _two_digits(probability: float | None) -> str:
    return "-" if probability is None else f"{probability:.2f}"


def _significance(parameter: dict[str, Any]) -> float:
    return abs(float(parameter["value"])) / float(parameter["std"] or np.inf)


def shortened(names: Sequence[str], most: int) -> str:
    """Names in a row, the last ones counted where they are many.

    >>> shortened(["a", "b", "c"], 2), shortened(["a", "b"], 2)
    ('a, b and 1 more', 'a, b')
    """
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _located(places: list[dict[str, Any]], effects: list[dict[str, Any]]) -> Table:
    table = plain_table(
        ("where", "left"), ("depends on", "left"), ("share of the gap", "right"), ("cause", "left")
    )
    for column in table.columns:
        column.overflow = "fold"
    left = list(effects)
    for place in places:
        own = next((e for e in left if _same_place(e, place)), None)
        if own is not None:
            left.remove(own)
        table.add_row(
            place["where"],
            place["depends_on"],
            percent(place["share_of_gap"]),
            "unknown" if own is None else own["effect"],
        )
    return table


def _same_place(effect: dict[str, Any], place: dict[str, Any]) -> bool:
    return bool(
        effect["where"] == place["where"] and effect["share_of_gap"] == place["share_of_gap"]
    )


def _notes(fields: dict[str, Any]) -> Iterator[Text]:
    """Poses left out, and causes that the table has no columns for."""
    outliers = fields["outliers"]
    if outliers:
        yield Text("")
    if len(outliers) <= _MOST_OUTLIERS:
        for entry in outliers:
            yield Text(f"outlier {entry['pose']}: {entry['reason']}")
    else:
        poses = shortened([entry["pose"] for entry in outliers], 8)
        yield Text(f"{len(outliers)} outliers left out: {poses}")
    if fields.get("approach_derived"):
        first = shortened(fields["not_fitted"], 3)
        unknown = f"; {first}, where it is unknown, took no part" if first else ""
        yield Text(f"\napproach: derived from the order of the poses{unknown}")
    reasons: dict[str, list[str]] = {}
    for entry in fields["not_asked"]:
        reason = entry["reason"].removeprefix(f"{entry['effect']} cannot act: ")
        kind = entry["effect"].split(":")[0]
        reasons.setdefault(reason, []).append(entry["effect"] if reason == EXCLUDED else kind)
    if reasons:
        yield Text("")
    for reason, kinds in reasons.items():
        yield Text(f"not asked: {', '.join(dict.fromkeys(kinds))}; {reason}")
