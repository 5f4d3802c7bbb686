"""The score of many answers, and how it is printed: rates, calibration, held-out errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.console import Console
from scipy.stats import binom

from studies.research.withheld.figures import DRAWN, FIRST, REAL, SENSED, Questions, Rate
from studies.research.withheld.judge import Judgement, judge
from studies.research.withheld.seal import Answered, opened
from studies.research.withheld.tables import table

BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
MANY = 40  # configurations of a plan from which held-out errors are held against the floor


def score(folder: Path) -> dict[str, Any]:
    """The whole score of a folder, as written to JSON. Raises BrokenSeal.

    At the top that of the first program, the diagnosis where it answered; the others as ``rivals``.
    """
    keys, answered = opened(folder)
    first, *others = answered
    return {
        "schema": 1,
        "command": "withheld score",
        "program": first,
        **score_of(keys, answered[first]),
        "rivals": {name: score_of(keys, answered[name]) for name in others},
    }


def score_of(keys: dict[str, Any], answered: Answered) -> dict[str, Any]:
    """The score of one program."""
    judged = [judged_or_failed(keys[name], answer) for name, answer in answered.answers.items()]
    drawn = {key.get("draw") for key in keys.values()}
    asked = REAL if "real arms" in drawn else SENSED if DRAWN in drawn else FIRST
    return {
        "cases": len(judged),
        "families": Counter(j.family for j in judged),
        "failed": sum(not j.answered for j in judged),
        "names": any(j.named for j in judged),
        "seconds": _quantiles([run["seconds"] for run in answered.runs.values()]),
        "rates": [rate.as_dict() for rate in asked.rates(judged)],
        "reliability": reliability(judged),
        "coverage": coverage(judged).as_dict(),
        "heldout_over_floor": floors(judged, asked),
        "answers": [_short(j) for j in judged],
    }


def judged_or_failed(key: dict[str, Any], answer: dict[str, Any] | None) -> Judgement:
    """An answer that cannot be read as one is none."""
    try:
        return judge(key, answer)
    except (AttributeError, KeyError, TypeError, ValueError):
        return judge(key, None)


def reliability(judged: Iterable[Judgement]) -> list[dict[str, Any]]:
    """How often named effects are right, by the probability that the answer gives them."""
    stated = [s for j in judged for s in j.statements]
    table = []
    for low, high in pairwise(BINS):
        own = [s for s in stated if low < s[0] <= high or (low == 0.0 == s[0])]
        mean = sum(p for p, _ in own) / len(own) if own else None
        rate = Rate(f"{low:g} to {high:g}", "right", sum(right for _, right in own), len(own))
        table.append({**rate.as_dict(), "stated": mean})
    return table


def coverage(judged: Iterable[Judgement]) -> Rate:
    """95 % intervals of the parameters of rightly named effects, singles and pairs."""
    held = [h for j in judged for h in j.intervals]
    return Rate("parameters", "truth within 1.96 std", sum(held), len(held), (0.93, 0.97))


def floors(judged: Iterable[Judgement], asked: Questions = FIRST) -> dict[str, Any]:
    """Held-out RMS after over the true floor: visible effects, at least 40 configurations."""
    found = _floors(j for j in judged if j.family in asked.floors and j.visible)
    ends = (found["median_ci95"], found["p90_ci95"])
    reached = all(map(_reaches, ends, asked.floor_bars))
    bars = {"families": list(asked.floors), "bars": list(asked.floor_bars)}
    return {**found, **bars, "met": reached if found["n"] else None}


def _floors(judged: Iterable[Judgement]) -> dict[str, Any]:
    own = [j for j in judged if j.conditions["configurations"] >= MANY]
    found = _quantiles([j.over_floor for j in own])
    for name in ("before_over_floor", "over_reach"):
        other = _quantiles([getattr(j, name) for j in own])
        prefix = name.removesuffix("_over_floor").removeprefix("over_")
        found |= {f"{prefix}_median": other["median"], f"{prefix}_p90": other["p90"]}
    return found


def _reaches(interval: list[float | None] | None, bar: float) -> bool:
    return interval is not None and interval[0] is not None and interval[0] <= bar


def _quantiles(values: Sequence[float]) -> dict[str, Any]:
    """Median and ninth decile with distribution-free intervals; null stands for infinite."""
    ordered, n = sorted(values), len(values)
    found: dict[str, Any] = {"n": n}
    for name, p in (("median", 0.5), ("p90", 0.9)):
        if not n:
            found |= {name: None, f"{name}_ci95": None}
            continue
        low, high = binom.ppf([0.025, 0.975], n, p)
        ends = (ordered[max(int(low) - 1, 0)], ordered[min(int(high), n - 1)])
        found[name] = _finite(ordered[min(math.ceil(p * n) - 1, n - 1)])
        found[f"{name}_ci95"] = [_finite(v) for v in ends]
    return found


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _short(j: Judgement) -> dict[str, Any]:
    names = ["case", "family", "robot", "truth", "noncentrality", "visible", "verdict", "named"]
    names += ["exact", "found", "located", "misnamed"]
    shown = {name: getattr(j, name) for name in names}
    ends = {name: _finite(getattr(j, name)) for name in ("before_over_floor", "over_floor")}
    faint = [cause.name for cause in j.causes if not cause.visible]
    return {**shown, **ends, "faint": faint, "missed": [c.name for c in j.causes if not c.found]}


Row = dict[str, Any]
_BY_ANYONE = ("false alarms",)  # figures of programs that name nothing, too
_NONE = "-"


def show(console: Console, result: Row) -> None:
    """Print the score: each figure against its bar, rivals beside; probabilities; held-out errors."""
    scores = {result["program"]: result, **result["rivals"]}
    families = ", ".join(f"{n} {family}" for family, n in sorted(result["families"].items()))
    console.print(f"{result['cases']} sealed cases: {families}")
    for name, one in scores.items():
        median, ninth = (_ratio(one["seconds"][quantile]) for quantile in ("median", "p90"))
        console.print(
            f"  {name}: {one['failed']} without an answer; {median} s a case, ninth decile {ninth} s"
        )
    console.print("\nThe same cases, program by program (rates in %)")
    figures = zip(*map(_rated, scores.values()), strict=True)
    console.print(table(_figure(scores, rows) for rows in figures))
    console.print("  visible: noncentrality above 60 beside all that is modelled; faint: below.")
    console.print("\nOf effects named with some probability, how many are there (in %)")
    naming = {name: score for name, score in scores.items() if score["names"]}
    bins = zip(*(score["reliability"] for score in naming.values()), strict=True)
    console.print(table(_stated(dict(zip(naming, rows, strict=True))) for rows in bins))
    console.print("\nHeld-out RMS over the true floor, plans of at least 40 configurations")
    console.print(table(_heldout(name, one["heldout_over_floor"]) for name, one in scores.items()))


def _rated(score: Row) -> list[Row]:
    """Rates by family, and the coverage in the same form."""
    return [*score["rates"], {**score["coverage"], "figure": "95 % interval holds truth"}]


def _figure(scores: dict[str, Row], rows: Sequence[Row]) -> Row:
    """A figure of the first program with interval and bar, and the rate of each rival."""
    own, (first, *rivals) = rows[0], scores
    rated = dict(zip(scores, rows, strict=True))
    shown = {name: _rate_of(scores[name], row) for name, row in rated.items()}
    return {
        "cases": own["family"],
        "figure": own["figure"],
        "of": own["n"],
        "bar": _bar(own["bar"]),
        first: shown[first],
        "95 %": _interval(own["ci95"]),
        "met": {None: "", True: "yes", False: "no"}[own["met"]],
        **{name: shown[name] for name in rivals},
    }


def _rate_of(score: Row, row: Row) -> str:
    if row["rate"] is None or not (score["names"] or row["figure"] in _BY_ANYONE):
        return _NONE
    return f"{100 * row['rate']:.1f}"


def _stated(rows: dict[str, Row]) -> Row:
    """Of effects that were named with a probability within these bounds, how many are there."""
    found: Row = {"stated": next(iter(rows.values()))["family"]}
    for name, row in rows.items():
        counted = _NONE if row["rate"] is None else f"{100 * row['rate']:.1f} of {row['n']}"
        found |= {name: counted, f"95 %, {name}": _interval(row["ci95"])}
    return found


def _heldout(name: str, floor: Row) -> Row:
    """Median and ninth decile against their bars; infinite stands for a failed run."""
    found: Row = {"program": name, "cases": floor["n"]}
    if floor["n"]:
        for key, bar in zip(("median", "p90"), floor["bars"], strict=True):
            low, high = map(_ratio, floor[f"{key}_ci95"])
            found |= {key: f"{_ratio(floor[key])} ({low} to {high})", f"{key} bar": f"{bar:g}"}
        for key in ("before", "reach"):
            found[f"{key}, median"] = _ratio(floor[f"{key}_median"])
    return found


def _bar(bar: tuple[float, float] | None) -> str:
    if bar is None:
        return ""
    low, high = (f"{100 * end:.0f}" for end in bar)
    if bar[0] == 0.0:
        return f"max {high}"
    return f"min {low}" if bar[1] == 1.0 else f"{low} to {high}"


def _interval(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else f"{100 * interval[0]:.1f} to {100 * interval[1]:.1f}"


def _ratio(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.2f}"
