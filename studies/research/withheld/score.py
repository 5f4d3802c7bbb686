"""The score of many answers: rates with Wilson intervals, calibration, coverage, held-out errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from scipy.stats import binom

from studies.research.withheld.figures import DRAWN, FIRST, REAL, SENSED, Questions, Rate, verdicts
from studies.research.withheld.judge import Judgement, judge
from studies.research.withheld.seal import Answered, opened

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
        "rates": [rate.as_dict() for rate in rates(judged, asked)],
        "robots": [rate.as_dict() for rate in by_robot(judged, asked)],
        "conditions": [rate.as_dict() for rate in by_condition(judged, asked)],
        "causes": [rate.as_dict() for rate in by_cause(judged)],
        "reliability": reliability(judged),
        "coverage": coverage(judged).as_dict(),
        "coverage_by_effect": [rate.as_dict() for rate in coverage_by_effect(judged)],
        "heldout_over_floor": floors(judged, asked),
        "heldout_by_family": floors_by_family(judged, asked),
        "heldout_by_robot": floors_by_robot(judged),
        "outside_verdicts": verdicts(judged),
        "answers": [_short(j) for j in judged],
    }


def judged_or_failed(key: dict[str, Any], answer: dict[str, Any] | None) -> Judgement:
    """An answer that cannot be read as one is none."""
    try:
        return judge(key, answer)
    except (AttributeError, KeyError, TypeError, ValueError):
        return judge(key, None)


def rates(judged: Sequence[Judgement], asked: Questions = FIRST) -> list[Rate]:
    """Family by family."""
    return asked.rates(judged)


def by_condition(judged: Sequence[Judgement], asked: Questions = FIRST) -> list[Rate]:
    """The main figures again under each of the conditions that make a case hard."""
    groups = {name: list(filter(holds, judged)) for name, holds in asked.conditions.items()}
    return [rate for name, some in groups.items() for rate in _again(name, some, asked)]


def by_robot(judged: Sequence[Judgement], asked: Questions = FIRST) -> list[Rate]:
    """The main figures again for each robot."""
    groups = {name: [j for j in judged if j.robot == name] for name in _robots(judged)}
    return [rate for name, some in groups.items() for rate in _again(name, some, asked)]


def _robots(judged: Iterable[Judgement]) -> list[str]:
    return sorted({j.robot for j in judged})


def _again(name: str, some: Sequence[Judgement], asked: Questions) -> list[Rate]:
    found = {(rate.family, rate.figure): rate for rate in asked.rates(some)}
    return [Rate(name, figure, *_count(found[family, figure])) for family, figure in asked.again]


def _count(rate: Rate) -> tuple[int, int]:
    return rate.hits, rate.n


def by_cause(judged: Sequence[Judgement]) -> list[Rate]:
    """Of each cause what is named within its class, or outside the catalogue unknown and located."""
    found = []
    for family in ("single", "instrument", "mixture", "whole", "outside"):
        own = [j for j in judged if j.family == family]
        told = [(c.name, c.found) for j in own for c in j.causes if c.visible]
        if family == "outside":
            told = [(j.truth[0], j.unknown_located) for j in own if j.visible]
        groups: dict[str, list[bool]] = {}
        for name, hit in told:
            groups.setdefault(name.partition(":")[0], []).append(hit)
        found += [Rate(family, name, sum(h), len(h)) for name, h in sorted(groups.items())]
    return found


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


def coverage_by_effect(judged: Iterable[Judgement]) -> list[Rate]:
    """The same, effect by effect."""
    held = [one for j in judged for one in j.covered]
    own = {effect: [h for e, h in held if e == effect] for effect in sorted({e for e, _ in held})}
    return [Rate("parameters", effect, sum(h), len(h)) for effect, h in own.items()]


def floors(judged: Iterable[Judgement], asked: Questions = FIRST) -> dict[str, Any]:
    """Held-out RMS after over the true floor: visible effects, at least 40 configurations."""
    found = _floors(j for j in judged if j.family in asked.floors and j.visible)
    ends = (found["median_ci95"], found["p90_ci95"])
    reached = all(map(_reaches, ends, asked.floor_bars))
    bars = {"families": list(asked.floors), "bars": list(asked.floor_bars)}
    return {**found, **bars, "met": reached if found["n"] else None}


def floors_by_family(judged: Sequence[Judgement], asked: Questions = FIRST) -> list[dict[str, Any]]:
    """The same family by family, with what the user's model alone leaves."""
    found = []
    for family in asked.families:
        own = [j for j in judged if j.family == family and (j.visible or family == "null")]
        found.append({"family": family, **_floors(own)})
    return found


def floors_by_robot(judged: Sequence[Judgement]) -> list[dict[str, Any]]:
    """The same robot by robot, single visible effects."""
    own = [j for j in judged if j.family == "single" and j.visible]
    return [
        {"robot": name, **_floors(j for j in own if j.robot == name)} for name in _robots(judged)
    ]


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
