"""What was said of a day against what was true, and counts of that with intervals."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from rich.table import Table

from studies.document.terminal import plain_table
from studies.research.bench import rate
from studies.research.benchmarks.conclusions.days import VISIBLE, Day, TrueCause
from studies.research.withheld.judge import Entry, is_listed, is_named, name_of

Row = dict[str, Any]
RIGHT, IN_CLASS, WRONG = "right", "in_class", "wrong"
FAMILY = 2 / 3
_TWINS = {
    "instrument": "base",
    "tracker_drift": "base_drift",
    "friction_windup": "backlash",
}
_KEPT = (
    "effect", "where", "probability", "standing", "p_value", "shape_p_value", "shape_power",
    "shape_tested", "share_of_gap", "chosen_again", "curve_ratio",
)  # fmt: skip


def judged(day: Day, said: Row) -> Row:
    """Truth, answer, and what of it is right."""
    effects = [_effect(e, day.causes) for e in said.get("effects") or []]
    found = [_found(said, cause) for cause in day.causes]
    located = [(p["where"], p["depends_on"]) for p in said.get("located") or []]
    return {
        "kind": day.kind,
        "arm": day.scene.arm.name,
        "configurations": day.scene.count,
        "ratio": day.ratio,
        "in_joints": day.scene.scatter is not None and bool(day.scene.scatter.joints.any()),
        **day.more,
        "truth": [f"{cause.kind}:{cause.where}" for cause in day.causes],
        "sizes": [cause.size for cause in day.causes],
        "noncentrality": list(day.noncentrality),
        "verdict": said["verdict"],
        "rest": said.get("rest"),
        "gap": said.get("gap"),
        "noise": said.get("noise"),
        "located": located[:4],
        "located_first": bool(located and day.causes) and located[0][0] in _places(day.causes[0]),
        "effects": effects,
        "refused": [f"{r['effect']}:{r['where']}" for r in said.get("refused") or []],
        "outliers": len(said.get("outliers") or []),
        "error": said.get("error"),
        "seconds": said["seconds"],
        "found": [how is not None for how in found],
        "by_name": [how == RIGHT for how in found],
        "wrong": sum(e["outcome"] == WRONG for e in effects),
        "members": day.family,
        "family": _family(day, found),
    }  # fmt: skip


def outcome(effect: Entry, causes: Sequence[TrueCause]) -> str:
    """Whether a named effect is a true one, may be by its class, or is not there."""
    truths = [name for cause in causes for name in cause.names]
    if any(is_named(effect, truth) for truth in truths):
        return RIGHT
    return IN_CLASS if any(is_listed(effect, truth) for truth in truths) else WRONG


def _places(cause: TrueCause) -> set[str]:
    """Where it sits, by any of its names."""
    return {cause.where, *(str(name["where"]) for name in cause.names)}


def _found(said: Row, cause: TrueCause) -> str | None:
    """How the best of the effects has a cause."""
    outcomes = [outcome(e, [cause]) for e in said.get("effects") or []]
    return next((how for how in (RIGHT, IN_CLASS) if how in outcomes), None)


def _family(day: Day, found: Sequence[str | None]) -> Row | None:
    """How many of the visible members are named as such."""
    if not day.family:
        return None
    members = zip(found[: day.family], day.noncentrality, strict=False)
    visible = [how is not None for how, beside in members if beside > VISIBLE]
    named = sum(visible)
    return {"named": named, "visible": len(visible), "found": named >= FAMILY * len(visible)}


def _entry(effect: Entry) -> float | None:
    """Probability of an effect by any of its names: base and instrument move everything alike."""
    if effect.get("probability") is None:
        return None
    alike = [e for e in effect.get("class") or [effect] if _same(e) == _same(effect)]
    return max(sum(e.get("probability") or 0.0 for e in alike), float(effect["probability"]))


def _same(effect: Entry) -> tuple[str, str]:
    """Effect and place by the first of the names that mean the same."""
    kind, where = str(effect["effect"]), str(effect["where"])
    return _TWINS.get(kind, kind), _TWINS.get(where, where)


def _effect(effect: Entry, causes: Sequence[TrueCause]) -> Row:
    given = [p for p in effect.get("parameters") or [] if p.get("std")]
    return {
        **{key: effect.get(key) for key in _KEPT},
        "class": [(name_of(e), e.get("probability")) for e in effect.get("class") or []],
        "class_size": len(effect.get("class") or []),
        "entry": _entry(effect),
        "size_in_std": max((abs(p["value"] / p["std"]) for p in given), default=None),
        "parameters": effect.get("parameters"),
        "outcome": outcome(effect, causes),
    }


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
        lines.setdefault(kind, []).append(rate(hits, n, ends=kind == "all"))
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
            table.add_row(label, rate(right, n), rate(within, n))
    return table


def _outcomes(effects: Sequence[Row]) -> tuple[int, int, int]:
    outcomes = [e["outcome"] for e in effects]
    return outcomes.count(RIGHT), len(outcomes) - outcomes.count(WRONG), len(outcomes)


def _verdict(row: Row) -> str:
    rest = (row["rest"] or {}).get("kind")
    return f"{row['verdict']} ({rest})" if rest else str(row["verdict"])
