"""Counts with Wilson's intervals: what each part is asked, kind by kind, and how probabilities hold."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from rich.table import Table

from studies.research.benchmarks.conclusions.judged import RIGHT, WRONG
from studies.research.withheld.figures import wilson
from studies.tables import plain_table

Row = dict[str, Any]
Test = Callable[[Row], bool | None]
"""None where a day is not asked."""
BINS = (0.0, 0.5, 0.8, 0.9)
_CONFIDENT = 0.9


def _told_as_large(row: Row) -> bool:
    return row["verdict"] == "unknown" or (row["rest"] or {}).get("kind") == "too_large"


def _alone(row: Row) -> bool:
    return all(row["by_name"]) and not row["wrong"]


def _both(row: Row) -> bool | None:
    """Family and the single cause beside it."""
    single = len(row["truth"]) - row["members"]
    if row["family"] is None or not single:
        return None
    return bool(row["family"]["found"] and all(row["found"][-single:]))


def _sure_wrong(row: Row) -> bool:
    named = [e for e in row["effects"] if e["outcome"] == WRONG]
    return any((e["probability"] or 0.0) >= _CONFIDENT for e in named)


_NAMED: dict[str, Test] = {
    "right name": lambda r: all(r["by_name"]),
    "alone": _alone,
    "in class": lambda r: all(r["found"]),
    "wrong named": lambda r: r["wrong"] > 0,
    "wrong at .9": _sure_wrong,
    "explained": lambda r: r["verdict"] == "explained",
}
FIGURES: dict[str, dict[str, Test]] = {
    "arm_a": _NAMED,
    "nothing": {
        "no_gap": lambda r: r["verdict"] == "no_gap",
        "named": lambda r: r["wrong"] > 0,
    },
    "loud": {
        "unknown or too large": _told_as_large,
        "named": lambda r: r["wrong"] > 0,
    },
    "foreign": _NAMED,
    "outside": {
        "located first": lambda r: bool(r["located_first"]),
        "unknown": lambda r: r["verdict"] == "unknown",
        "wrong named": lambda r: r["wrong"] > 0,
        "wrong at .9": _sure_wrong,
        "explained": lambda r: r["verdict"] == "explained",
    },
    "hard": {
        "in class": lambda r: all(r["found"]) if r["family"] is None else None,
        "family": lambda r: None if r["family"] is None else r["family"]["found"],
        "pair": _both,
        "wrong named": lambda r: r["wrong"] > 0,
        "wrong at .9": _sure_wrong,
        "explained": lambda r: r["verdict"] == "explained",
    },
}


def rates(part: str, rows: Sequence[Row]) -> Iterator[tuple[str, str, int, int]]:
    """Kind, figure, hits and days; of all kinds together first."""
    kinds = {"all": list(rows)}
    for row in rows:
        kinds.setdefault(row["kind"], []).append(row)
    for kind, own in kinds.items() if len(kinds) > 2 else [("all", list(rows))]:
        for figure, test in FIGURES[part].items():
            asked = [hit for hit in map(test, own) if hit is not None]
            yield kind, figure, sum(asked), len(asked)


def table_of(part: str, rows: Sequence[Row]) -> Table:
    """One line a kind, one column a figure, the verdicts last, each with what remains."""
    table = plain_table((part, "left"), *((f, "right") for f in FIGURES[part]), ("", "left"))
    lines: dict[str, list[str]] = {}
    for kind, _, hits, n in rates(part, rows):
        lines.setdefault(kind, []).append(_shown(hits, n, with_ends=kind == "all"))
    for kind, cells in lines.items():
        own = [r for r in rows if kind in ("all", r["kind"])]
        said = Counter(map(_verdict, own)).most_common()
        table.add_row(kind, *cells, ", ".join(f"{n} {verdict}" for verdict, n in said))
    return table


def calibration(rows: Sequence[Row]) -> Iterator[tuple[str, int, int, int]]:
    """Of each range of probabilities, and of each standing: right, true one in the class, and all.

    Of an effect with two names that mean the same, both together have the probability.
    """
    named = [e for row in rows for e in row["effects"] if e["entry"] is not None]
    for low, high in pairwise((*BINS, math.inf)):
        own = [e for e in named if low <= e["entry"] < high]
        yield f"{low:g} to {min(high, 1.0):g}", *_outcomes(own)
    for standing in sorted({str(e["standing"]) for e in named if e["standing"]}):
        yield standing, *_outcomes([e for e in named if e["standing"] == standing])


def calibration_table(rows: Sequence[Row]) -> Table:
    """How often what is said with a probability is right."""
    table = plain_table(("probability", "left"), ("right", "right"), ("in class", "right"))
    for label, right, within, n in calibration(rows):
        if n:
            table.add_row(label, _shown(right, n), _shown(within, n))
    return table


def _outcomes(effects: Sequence[Row]) -> tuple[int, int, int]:
    outcomes = [e["outcome"] for e in effects]
    return outcomes.count(RIGHT), len(outcomes) - outcomes.count(WRONG), len(outcomes)


def _verdict(row: Row) -> str:
    rest = (row["rest"] or {}).get("kind")
    return f"{row['verdict']} ({rest})" if rest else str(row["verdict"])


def _shown(hits: int, n: int, with_ends: bool = True) -> str:
    if not n:
        return "-"
    if not with_ends:
        return f"{hits} of {n}"
    low, high = wilson(hits, n)
    return f"{hits} of {n}\n{100 * hits / n:.0f} % ({100 * low:.0f}-{100 * high:.0f})"
