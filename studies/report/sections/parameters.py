"""The parameters with their intervals, and which of them cannot be told apart."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from studies.noise_words import noise_words
from studies.report.evidence import Evidence, Result
from studies.report.parts import Part, Section, Table, Text, folded, listed

_TOGETHER = 0.9


def parameters(evidence: Evidence, result: Result) -> Section:
    """Values with 95 % intervals, correlations, and what the poses did not determine."""
    return Section("parameters", "What was identified", tuple(_parts(result.fields)))


def _parts(fields: dict[str, Any]) -> Iterator[Part]:
    yield Text(
        f"Approach {fields['approach']}, method {fields['method']}. The standard deviations rest on "
        f"this noise: {'; '.join(noise_words(fields['noise']))}. Base and tool are estimated with the "
        "rest and their uncertainty is counted. 95 of 100 such intervals hold the true value, if the "
        "model is right."
    )
    groups = ("base", "tool")
    own = [p for p in fields["parameters"] if p["effect"] not in groups]
    yield _table(own, "Parameters of the robot", folded("Parameters of the robot", own))
    placed = [p for p in fields["parameters"] if p["effect"] in groups]
    if placed:
        yield _table(placed, "Where base and markers are", folded("Base and markers", placed))
    for entry in fields["unidentifiable"]:
        yield Text(f"Not determined: {listed(entry['names'])}; {entry['reason']}.", "warn")
    if fields["weak"]:
        yield Text(f"More uncertain than such errors are large: {listed(fields['weak'])}.", "warn")
    yield from _correlated(fields)
    if fields["absorbed"]:
        rows = [(entry["id"], ", ".join(entry["absorbed_by"])) for entry in fields["absorbed"]]
        yield Table(
            ("constant error", "does the same as"),
            rows,
            fold=f"Errors that no pose can tell from those above ({len(rows)})",
        )


def _table(entries: list[dict[str, Any]], caption: str, fold: str | None) -> Part:
    rows = [(p["effect"], p["where"], p["name"], *_value(p), p["unit"]) for p in entries]
    return Table(
        (
            "effect",
            "where",
            "parameter",
            "value",
            "\N{PLUS-MINUS SIGN} 1 std",
            "95 % interval",
            "unit",
        ),
        rows,
        caption,
        fold=fold,
    )


def _value(p: dict[str, Any]) -> tuple[str, str, str]:
    """Value, deviation and interval, to two digits of the deviation."""
    std = p["std"]
    if not std:
        return f"{p['value']:.4g}", "not estimated", ""
    digits = max(0, 1 - math.floor(math.log10(std)))
    low, high = p["ci95"]
    return f"{p['value']:.{digits}f}", f"{std:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}"


def _correlated(fields: dict[str, Any]) -> Iterator[Part]:
    """Pairs of the robot's parameters that the data hardly tell apart."""
    entries = fields["parameters"]
    matrix = np.array(fields["correlation"], dtype=np.float64)
    own = [i for i, p in enumerate(entries) if p["effect"] not in ("base", "tool") and p["std"]]
    pairs = [
        (entries[a]["id"], entries[b]["id"], float(matrix[a, b]))
        for n, a in enumerate(own)
        for b in own[n + 1 :]
        if abs(matrix[a, b]) > _TOGETHER
    ]
    pairs.sort(key=lambda pair: -abs(pair[2]))
    if pairs:
        yield Table(
            ("parameter", "parameter", "correlation"),
            [(a, b, f"{r:+.3f}") for a, b, r in pairs],
            f"Pairs whose correlation is above {_TOGETHER}: their sum or difference is known better "
            "than each",
            fold=folded("Pairs that go together", pairs),
        )
