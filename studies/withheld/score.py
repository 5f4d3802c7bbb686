"""The score of many answers: rates with Wilson intervals, calibration, coverage, held-out errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from scipy.stats import binom

from studies.withheld.judge import Judgement, judge
from studies.withheld.seal import Answered, opened

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
    ("null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04)),
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
    ("single", True, "the same, and nothing else", lambda j: j.found and not j.further, None),
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
    "plain": lambda j: (
        not any(j.conditions[c] for c in ("wrong_sigma", "outliers", "hidden", "range_noise"))
    ),
    "sigma wrong": lambda j: bool(j.conditions["wrong_sigma"]),
    "outliers": lambda j: bool(j.conditions["outliers"]),
    "hidden markers": lambda j: bool(j.conditions["hidden"]),
    "15 configurations": lambda j: j.conditions["configurations"] < 40,
    "columns missing": lambda j: j.conditions["missing"] is not None,
    "rigid joints": lambda j: bool(j.conditions["rigid"]),
    "geometry known": lambda j: bool(j.conditions["known_geometry"]),
    "range noise, said": lambda j: j.conditions["range_noise"] == "said",
    "range noise, unsaid": lambda j: j.conditions["range_noise"] == "unsaid",
    "arm noise, said": lambda j: j.conditions.get("arm_noise") == "said",
    "arm noise, unsaid": lambda j: j.conditions.get("arm_noise") == "unsaid",
}
# The figures that are asked again of every robot and under every condition.
_AGAIN = (
    ("null", "false alarms"),
    ("single, visible", "named exactly"),
    ("single, visible", "within its class"),
    ("single, visible", "located"),
    ("pair, visible", "both found"),
    ("outside, visible", "unknown and located"),
    ("shape, visible", "right cause listed"),
)
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
    judged = [judged_or_failed(key, answered.answers[name]) for name, key in keys.items()]
    return {
        "cases": len(judged),
        "families": Counter(j.family for j in judged),
        "failed": sum(not j.answered for j in judged),
        "names": any(j.named for j in judged),
        "seconds": _quantiles([run["seconds"] for run in answered.runs.values()]),
        "rates": [rate.as_dict() for rate in rates(judged)],
        "robots": [rate.as_dict() for rate in by_robot(judged)],
        "conditions": [rate.as_dict() for rate in by_condition(judged)],
        "causes": [rate.as_dict() for rate in by_cause(judged)],
        "reliability": reliability(judged),
        "coverage": coverage(judged).as_dict(),
        "coverage_by_effect": [rate.as_dict() for rate in coverage_by_effect(judged)],
        "heldout_over_floor": floors(judged),
        "heldout_by_family": floors_by_family(judged),
        "heldout_by_robot": floors_by_robot(judged),
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
    """The main figures again under each of the conditions that make a case hard."""
    return [r for name, holds in _HARD.items() for r in _again(name, filter(holds, judged))]


def by_robot(judged: Sequence[Judgement]) -> list[Rate]:
    """The main figures again for each robot."""
    robots = sorted({j.robot for j in judged})
    return [r for name in robots for r in _again(name, (j for j in judged if j.robot == name))]


def _again(name: str, some: Iterable[Judgement]) -> list[Rate]:
    found = {(rate.family, rate.figure): rate for rate in rates(list(some))}
    return [Rate(name, figure, *_count(found[family, figure])) for family, figure in _AGAIN]


def _count(rate: Rate) -> tuple[int, int]:
    return rate.hits, rate.n


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


def coverage_by_effect(judged: Iterable[Judgement]) -> list[Rate]:
    """The same, effect by effect."""
    held = [one for j in judged for one in j.covered]
    own = {effect: [h for e, h in held if e == effect] for effect in sorted({e for e, _ in held})}
    return [Rate("parameters", effect, sum(h), len(h)) for effect, h in own.items()]


def floors(judged: Iterable[Judgement]) -> dict[str, Any]:
    """Held-out RMS after over the true floor: single visible effects, at least 40 configurations."""
    found = _floors(j for j in judged if j.family == "single" and j.visible)
    median, ninth = found["median_ci95"], found["p90_ci95"]
    found["met"] = None if not found["n"] else _reaches(median, 1.05) and _reaches(ninth, 1.2)
    return found


def floors_by_family(judged: Sequence[Judgement]) -> list[dict[str, Any]]:
    """The same family by family, with what the user's model alone leaves."""
    found = []
    for family in dict.fromkeys(family for family, *_ in _FIGURES):
        own = [j for j in judged if j.family == family and (j.visible or family == "null")]
        found.append({"family": family, **_floors(own)})
    return found


def floors_by_robot(judged: Sequence[Judgement]) -> list[dict[str, Any]]:
    """The same robot by robot, single visible effects."""
    own = [j for j in judged if j.family == "single" and j.visible]
    robots = sorted({j.robot for j in judged})
    return [{"robot": name, **_floors(j for j in own if j.robot == name)} for name in robots]


def _floors(judged: Iterable[Judgement]) -> dict[str, Any]:
    own = [j for j in judged if j.conditions["configurations"] >= MANY]
    before = _quantiles([j.before_over_floor for j in own])
    found = {"before_median": before["median"], "before_p90": before["p90"]}
    return {**_quantiles([j.over_floor for j in own]), **found}


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
    return {**shown, **ends}
