"""The score of many answers: rates by family with Wilson intervals, calibration, coverage, floors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from scipy.stats import binom

from studies.withheld.judge import Judgement, judge
from studies.withheld.seal import opened, read_json

BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
_Z = 1.959964


@dataclass(frozen=True)
class Rate:
    """hits of n, with the 95 % Wilson interval and the bar that it is to reach.

    bar : (lowest, highest) rate wanted, or None
    """

    family: str
    figure: str
    hits: int
    n: int
    bar: tuple[float, float] | None = None

    @property
    def rate(self) -> float | None:
        """Share, None of nothing."""
        return self.hits / self.n if self.n else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Wilson's interval."""
        return wilson(self.hits, self.n) if self.n else None

    @property
    def met(self) -> bool | None:
        """The interval reaches the bar."""
        if self.bar is None or self.interval is None:
            return None
        return self.interval[1] >= self.bar[0] and self.interval[0] <= self.bar[1]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        more = {"rate": self.rate, "ci95": self.interval, "met": self.met}
        return {**asdict(self), **more}


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % interval of a share."""
    p, z2 = hits / n, _Z**2
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = _Z / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)


Test = Callable[[Judgement], bool]
# family, visible only, figure, test, bar
_FIGURES: tuple[tuple[str, bool | None, str, Test, tuple[float, float] | None], ...] = (
    ("null", None, "false alarms", lambda j: j.verdict != "no_gap", (0.0, 0.04)),
    ("single", True, "something found", lambda j: j.gap, None),
    ("single", True, "named exactly", lambda j: j.exact, (0.85, 1.0)),
    (
        "single",
        True,
        "named exactly, or has a twin",
        lambda j: j.exact or (j.twin and j.found),
        None,
    ),
    ("single", True, "within its class", lambda j: j.found, (0.93, 1.0)),
    ("single", True, "located", lambda j: j.located, (0.93, 1.0)),
    ("single", True, "further effects named", lambda j: j.further, None),
    ("single", True, "confidently misnamed", lambda j: j.misnamed, None),
    ("single", False, "something found", lambda j: j.gap, None),
    ("single", False, "within its class", lambda j: j.found, None),
    ("single", False, "confidently misnamed", lambda j: j.misnamed, None),
    ("pair", True, "both found", lambda j: j.found, (0.75, 1.0)),
    ("pair", True, "named exactly", lambda j: j.exact, None),
    ("pair", True, "both located", lambda j: j.located, None),
    ("pair", False, "both found", lambda j: j.found, None),
    ("outside", True, "something found", lambda j: j.gap, None),
    ("outside", True, "unknown and located", lambda j: j.unknown_located, (0.85, 1.0)),
    ("outside", True, "located", lambda j: j.located, None),
    ("outside", True, "located with its variable", lambda j: j.depends, None),
    ("outside", True, "confidently misnamed", lambda j: j.misnamed, (0.0, 0.04)),
    ("shape", True, "right cause listed", lambda j: j.found, (0.85, 1.0)),
    ("shape", True, "located", lambda j: j.located, None),
    ("shape", True, "called explained", lambda j: j.explained, (0.0, 0.10)),
)
_HARD: dict[str, Test] = {
    "plain": lambda j: not any(j.conditions[c] for c in ("wrong_sigma", "outliers", "hidden")),
    "sigma wrong": lambda j: bool(j.conditions["wrong_sigma"]),
    "outliers": lambda j: bool(j.conditions["outliers"]),
    "hidden markers": lambda j: bool(j.conditions["hidden"]),
    "15 configurations": lambda j: j.conditions["configurations"] < 40,
    "columns missing": lambda j: j.conditions["missing"] is not None,
    "rigid joints": lambda j: bool(j.conditions["rigid"]),
    "geometry known": lambda j: bool(j.conditions["known_geometry"]),
}


def score(folder: Path) -> dict[str, Any]:
    """The whole score of a folder, as written to JSON. Raises BrokenSeal."""
    keys, answers = opened(folder)
    runs = read_json(folder / "answers.json")["runs"]
    judged = [judged_or_failed(keys[name], answers[name]) for name in keys]
    return {
        "schema": 1,
        "command": "withheld score",
        "cases": len(judged),
        "failed": sum(not j.answered for j in judged),
        "seconds": _quantiles([run["seconds"] for run in runs.values()]),
        "rates": [rate.as_dict() for rate in rates(judged)],
        "conditions": [rate.as_dict() for rate in by_condition(judged)],
        "causes": [rate.as_dict() for rate in by_cause(judged)],
        "reliability": reliability(judged),
        "coverage": coverage(judged).as_dict(),
        "heldout_over_floor": floors(judged),
        "answers": [_short(j) for j in judged],
    }


def judged_or_failed(key: dict[str, Any], answer: dict[str, Any] | None) -> Judgement:
    """An answer that cannot be read as one is none."""
    try:
        return judge(key, answer)
    except (AttributeError, KeyError, TypeError, ValueError):
        return judge(key, None)


def rates(judged: Sequence[Judgement]) -> list[Rate]:
    """Family by family."""
    found = []
    for family, visible, figure, test, bar in _FIGURES:
        some = [j for j in judged if j.family == family and visible in (None, j.visible)]
        kind = {None: family, True: f"{family}, visible", False: f"{family}, faint"}[visible]
        found.append(Rate(kind, figure, sum(map(test, some)), len(some), bar))
    return found


def by_condition(judged: Sequence[Judgement]) -> list[Rate]:
    """The first figures again under each of the conditions that make a case hard."""
    found = []
    for name, holds in _HARD.items():
        nulls = [j for j in judged if j.family == "null" and holds(j)]
        single = [j for j in judged if j.family == "single" and j.visible and holds(j)]
        alarms = sum(j.verdict != "no_gap" for j in nulls)
        found.append(Rate(name, "false alarms", alarms, len(nulls)))
        found.append(Rate(name, "named exactly", sum(j.exact for j in single), len(single)))
        found.append(Rate(name, "within its class", sum(j.found for j in single), len(single)))
    return found


def by_cause(judged: Sequence[Judgement]) -> list[Rate]:
    """Of each cause what is named within its class, or outside the catalogue unknown and located."""
    tests: dict[str, Test] = {"single": lambda j: j.found, "outside": lambda j: j.unknown_located}
    found = []
    for family, test in tests.items():
        some = [j for j in judged if j.family == family and j.visible]
        for cause in sorted({j.truth[0].partition(":")[0] for j in some}):
            own = [j for j in some if j.truth[0].startswith(f"{cause}:")]
            found.append(Rate(family, cause, sum(map(test, own)), len(own)))
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


def floors(judged: Iterable[Judgement]) -> dict[str, Any]:
    """Held-out RMS after over the true floor: single visible effects, at least 40 configurations."""
    own = [
        j.over_floor
        for j in judged
        if j.family == "single" and j.visible and j.conditions["configurations"] >= 40
    ]
    found = _quantiles(own)
    median, ninth = found["median_ci95"], found["p90_ci95"]
    found["met"] = None if not own else _reaches(median, 1.05) and _reaches(ninth, 1.2)
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
    return {**{name: getattr(j, name) for name in names}, "over_floor": _finite(j.over_floor)}
