"""What a plan can and cannot see, before anything is measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from studies.report.evidence import Evidence, Result
from studies.report.parts import Part, Section, Table, Text, folded


def sight(evidence: Evidence, result: Result) -> Section:
    """Smallest sizes that would be found, causes that are taken for others, twins."""
    return Section("sight", "What the plan can and cannot see", tuple(_parts(result.fields)))


def _parts(fields: dict[str, Any]) -> Iterator[Part]:
    yield Text(
        "For each cause of error that the model lacks: the smallest size that a diagnosis of these "
        f"poses finds {round(100 * fields['power'])} times in 100, if it is the only one."
    )
    seen = [e for e in fields["could_not_see"] if e["minimum_detectable"] is not None]
    rows = [
        (
            e["effect"],
            e["where"],
            e["parameter"],
            e["minimum_detectable"],
            e["plausible"],
            e["unit"],
        )
        for e in seen
    ]
    yield Table(
        ("cause", "where", "parameter", "smallest found", "usual size", "unit"),
        rows,
        fold=folded("Smallest sizes that are found", rows),
    )
    blind = [e for e in fields["could_not_see"] if e["minimum_detectable"] is None]
    if blind:
        reasons = [(e["effect"], e["where"], e["reason"]) for e in blind]
        yield Table(
            ("cause", "where", "why"), reasons, fold=f"Not visible at any size ({len(blind)})"
        )
    if fields["twins"]:
        groups = [
            (
                " and ".join(_name(member) for member in group["members"]),
                "; ".join(group["split_by"]) or "nothing that was tried",
            )
            for group in fields["twins"]
        ]
        yield Table(("stand for each other at any size", "told apart by"), groups)
    if fields["look_alikes"]:
        pairs = [
            (_name(e), _name(e["like"]), e["rho"], e["told_apart_from"], e["unit"])
            for e in fields["look_alikes"]
        ]
        yield Table(
            ("cause", "is taken for", "correlation", "told apart from", "unit"),
            pairs,
            fold=f"Causes that look alike when they are small ({len(pairs)})",
        )


def _name(entry: dict[str, Any]) -> str:
    return f"{entry['effect']}:{entry['where']}"
