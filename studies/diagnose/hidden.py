"""What a diagnosis could not have seen: one line for each kind of effect."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from studies.tables import plain_table

_LONG = 12  # characters of a place that is no longer named beside a number


def hidden_table(entries: list[dict[str, Any]]) -> Iterator[RenderableType]:
    """The smallest sizes that would have been found, over the places, and what no pose shows.

    entries : ``could_not_see`` of the result
    """
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for entry in entries:
        if entry["minimum_detectable"] is not None:
            groups.setdefault((entry["effect"], entry["unit"]), []).append(entry)
    blind = {
        kind: [e["where"] for e in entries if e["effect"] == kind and _unseen(e)]
        for kind in dict.fromkeys(e["effect"] for e in entries)
    }
    seen = {kind for kind, _ in groups}
    if groups:
        yield Text("\nsmallest size that would have been found (nine times in ten)")
        table = plain_table(
            ("effect", "left"), ("at best", "left"), ("at worst", "left"), ("unit", "left"),
            ("not visible at", "left"),
        )  # fmt: skip
        for (kind, unit), members in groups.items():
            members.sort(key=lambda e: float(e["minimum_detectable"]))
            choice = len(members) + len(blind[kind]) > 1
            worst = _size(members[-1], choice) if len(members) > 1 else ""
            table.add_row(kind, _size(members[0], choice), worst, unit, ", ".join(blind[kind]))
        yield table
    nowhere = [kind for kind in blind if kind not in seen]
    if nowhere:
        yield Text(f"\nnot visible at these poses, wherever it acts: {', '.join(nowhere)}")


def _unseen(entry: dict[str, Any]) -> bool:
    return entry["minimum_detectable"] is None


def _size(entry: dict[str, Any], choice: bool) -> str:
    """Two digits, with the place where there is a choice of them."""
    digits = f"{entry['minimum_detectable']:.1e}"
    text = f"{float(digits):g}"
    return f"{text} ({entry['where']})" if choice and len(entry["where"]) <= _LONG else text
