"""What a plan can tell, as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from textwrap import wrap
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from studies.tables import plain_table

_MOST_PAIRS = 12
_LONG = 8  # letters of a joint's name that a column takes
_WIDTH = 100
_INDENT = " " * 11


def foresight_tables(
    name: str, joints: Sequence[str], fields: dict[str, Any]
) -> Iterator[RenderableType]:
    """Smallest sizes by cause and place, what is hidden and why, and what looks alike."""
    fields = _with_short_places(fields, joints)
    joints = [_short(joint, joints) for joint in joints]
    entries = fields["could_not_see"]
    yield Text("\n".join(_head(name, fields)))
    on_joints = [e for e in entries if e["where"] in joints and _any_seen(entries, e["effect"])]
    if on_joints:
        yield Text("\nsmallest size that is found nine times in ten, by joint", style="bold")
        yield _by_joint(on_joints, joints)
    elsewhere = [e for e in entries if e["where"] not in joints and not e["reason"]]
    if elsewhere:
        yield Text("")
        yield _elsewhere(elsewhere)
    if any(_unusual(e) for e in entries):
        yield Text("(in brackets: more than is usual, so one of usual size may go unseen)")
    yield from _hidden(entries)
    yield from _not_asked(fields["not_asked"])
    yield from _alike(fields)


def _head(name: str, fields: dict[str, Any]) -> Iterator[str]:
    seen = sum(e["reason"] is None for e in fields["could_not_see"])
    asked = len(fields["could_not_see"])
    yield f"{name}: this plan can see {seen} of {asked} causes, where they are large enough"
    hidden = fields["hidden_markers"]
    lost = f", {hidden} marker readings out of sight" if hidden else ""
    first = len(fields["before_the_first_move"])
    lost += f", {first} before the first move do not count" if first else ""
    yield f"reads      {fields['readings']} readings, {fields['points']} points{lost}"
    if fields["approach_derived"]:
        yield "approach   follows from the order of the poses"
    if fields["elastic_assumed"]:
        yield "elastic    as soft as usual: sizes of weights, springs and payload go with it"
    for entry in fields["unidentifiable"]:
        yield f"open       {', '.join(entry['names'])}: {entry['reason']}"


def _any_seen(entries: list[dict[str, Any]], effect: str) -> bool:
    return any(e["effect"] == effect and not e["reason"] for e in entries)


def _unusual(entry: dict[str, Any]) -> bool:
    size = entry["minimum_detectable"]
    return size is not None and size > entry["plausible"]


def _by_joint(entries: list[dict[str, Any]], joints: Sequence[str]) -> Table:
    table = plain_table(
        ("cause", "left"), ("of", "left"), *((label, "right") for label in _labels(joints))
    )
    for effect, group in groupby(entries, key=lambda e: e["effect"]):
        own = {e["where"]: e for e in group}
        seen = [e for e in own.values() if not e["reason"]]
        names, units = {e["parameter"] for e in seen}, {e["unit"] for e in seen}
        many = max(len(e["parameters"]) for e in seen)
        what = names.pop() if len(names) == 1 else f"best of {many}"
        unit = units.pop() if len(units) == 1 else "by joint"
        table.add_row(effect, Text(f"{what} [{unit}]"), *(_size(own.get(j)) for j in joints))
    return table


def _short(place: str, joints: Sequence[str]) -> str:
    """A joint's name without the end that all joints share, such as ``_joint``; others as they are."""
    shared = {joint.rpartition("_")[2] for joint in joints}
    cut = len(shared) == 1 and all("_" in joint for joint in joints)
    return place.rpartition("_")[0] if cut and place in joints else place


def _with_short_places(fields: dict[str, Any], joints: Sequence[str]) -> dict[str, Any]:
    """The same fields with joints named shortly; a parameter named by a joint keeps its name."""

    def shortened(entry: Any) -> Any:
        if isinstance(entry, list):
            return [shortened(part) for part in entry]
        if not isinstance(entry, dict):
            return entry
        own = {key: shortened(value) for key, value in entry.items()}
        return own | {"where": _short(own["where"], joints)} if "where" in own else own

    return {key: shortened(value) for key, value in fields.items()}


def _labels(joints: Sequence[str]) -> list[str]:
    """Names of joints for narrow columns, the long ones broken at underscores."""
    lines = [j.replace("_", "\n") if len(j) > _LONG else j for j in joints]
    depth = max(label.count("\n") for label in lines)
    return ["\n" * (depth - label.count("\n")) + label for label in lines]


def _size(entry: dict[str, Any] | None) -> str:
    if entry is None:
        return ""
    if entry["reason"]:
        return "hidden"
    shown = f"{entry['minimum_detectable']:.3g}"
    return f"({shown})" if _unusual(entry) else shown


def _elsewhere(entries: list[dict[str, Any]]) -> Table:
    table = plain_table(("cause", "left"), ("of", "left"), ("smallest", "right"), ("unit", "left"))
    for entry in entries:
        head = f"{entry['effect']}:{entry['where']}"
        table.add_row(head, entry["parameter"], _size(entry), entry["unit"])
    return table


def _hidden(entries: list[dict[str, Any]]) -> Iterator[Text]:
    """Hidden causes, by reason."""
    reasons = dict.fromkeys(e["reason"] for e in entries if e["reason"])
    for i, reason in enumerate(reasons):
        causes = [(e["effect"], e["where"]) for e in entries if e["reason"] == reason]
        counts = {e["effect"]: sum(x["effect"] == e["effect"] for x in entries) for e in entries}
        yield Text(("" if i else "\n") + _listed("hidden", _gathered(causes, counts), reason))


def _listed(head: str, causes: Iterable[str], reason: str) -> str:
    """Causes and what they share, wrapped below a head."""
    text = f"{head:11}{', '.join(causes)}:"
    lines = wrap(text, _WIDTH, subsequent_indent=_INDENT, break_on_hyphens=False)
    return "\n".join([*lines, _INDENT + reason])


def _gathered(causes: list[tuple[str, str]], counts: dict[str, int]) -> Iterator[str]:
    """``effect:where,where`` of each effect; its name alone where that is all of several places."""
    for effect, group in groupby(causes, key=lambda pair: pair[0]):
        places = [where for _, where in group]
        everywhere = len(places) == counts.get(effect) and len(places) > 1
        yield effect if everywhere else f"{effect}:{','.join(places)}"


def _not_asked(entries: list[dict[str, str]]) -> Iterator[Text]:
    """Causes that the plan's columns cannot speak of, by what is missing."""
    why = [(e["reason"].partition("cannot act: ")[2] or e["reason"], e["effect"]) for e in entries]
    for reason in dict.fromkeys(reason for reason, _ in why):
        causes = [effect.partition(":") for other, effect in why if other == reason]
        named = _gathered([(kind, where) for kind, _, where in causes], {})
        yield Text(_listed("not asked", named, reason))


def _alike(fields: dict[str, Any]) -> Iterator[RenderableType]:
    for group in fields["twins"]:
        names = " = ".join(f"{e['effect']}:{e['where']}" for e in group["members"])
        yield Text(f"\ntwins      {names}")
        yield Text(f"{_INDENT}{_remedy(group['split_by'])}")
    pairs = list(_once(p for p in fields["look_alikes"] if not _are_twins(p, fields["twins"])))
    if not pairs:
        return
    yield Text("\nwhat looks alike, and from which size on it is told apart", style="bold")
    table = plain_table(
        ("\ncause", "left"), ("\nis taken for", "left"), ("\nrho", "right"),
        ("told apart\nfrom", "right"), ("\nunit", "left"), ("times its\nsmallest", "right"),
    )  # fmt: skip
    for pair in pairs[:_MOST_PAIRS]:
        times = pair["told_apart_times"]
        table.add_row(
            f"{pair['effect']}:{pair['where']}",
            f"{pair['like']['effect']}:{pair['like']['where']}",
            f"{pair['rho']:.3f}",
            "never" if times is None else f"{pair['told_apart_from']:.3g}",
            "" if times is None else pair["unit"],
            "" if times is None else f"{times:.1f}",
        )
    yield table
    if len(pairs) > _MOST_PAIRS:
        yield Text(
            f"and {len(pairs) - _MOST_PAIRS} pairs that are easier to tell: JSON, look_alikes"
        )


def _once(pairs: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Each two causes once, the harder way round, which comes first."""
    shown: set[frozenset[tuple[str, str]]] = set()
    for pair in pairs:
        like = pair["like"]
        both = frozenset({(pair["effect"], pair["where"]), (like["effect"], like["where"])})
        if both not in shown:
            shown.add(both)
            yield pair


def _remedy(split_by: list[str]) -> str:
    if not split_by:
        return (
            "alike at any size, with other poses, loads or stations too: one name stands for both"
        )
    return f"alike at any size here; to tell them apart, {'; or '.join(split_by)}"


def _are_twins(pair: dict[str, Any], twins: list[dict[str, Any]]) -> bool:
    own = {"effect": pair["effect"], "where": pair["where"]}
    return any(own in group["members"] and pair["like"] in group["members"] for group in twins)
