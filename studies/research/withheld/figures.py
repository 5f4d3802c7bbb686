"""Rates with Wilson intervals, and which figures are asked of which family, with their bars."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, TypeAlias

from studies.research.withheld.judge import Judgement

Bar: TypeAlias = tuple[float, float]
Test: TypeAlias = Callable[[Judgement], bool]


@dataclass(frozen=True)
class Rate:
    """hits of n, with the 95 % Wilson interval and the bar that it is to reach.

    bar : (lowest, highest) rate wanted, or None
    """

    family: str
    figure: str
    hits: int
    n: int
    bar: Bar | None = None

    @property
    def rate(self) -> float | None:
        """Share, None of nothing."""
        return self.hits / self.n if self.n else None

    @cached_property
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
    from scipy.stats import binomtest

    low, high = binomtest(hits, n).proportion_ci(method="wilson")
    return float(low), float(high)


# family, visible only, figure, test, bar
Figure: TypeAlias = tuple[str, bool | None, str, Test, Bar | None]
FIGURES: tuple[Figure, ...] = (
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
HARD: dict[str, Test] = {
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
AGAIN = (
    ("null", "false alarms"),
    ("single, visible", "named exactly"),
    ("single, visible", "within its class"),
    ("single, visible", "located"),
    ("pair, visible", "both found"),
    ("outside, visible", "unknown and located"),
    ("shape, visible", "right cause listed"),
)


@dataclass(frozen=True)
class Questions:
    """What is asked of a set of cases.

    figures : family by family; conditions : groups of cases in which the main figures are asked again
    again : family and figure of these
    floors, floor_bars : families whose held-out errors are held against the floor; largest median
        and ninth decile wanted
    """

    figures: tuple[Figure, ...]
    conditions: dict[str, Test]
    again: tuple[tuple[str, str], ...]
    floors: tuple[str, ...]
    floor_bars: tuple[float, float]

    def rates(self, judged: Sequence[Judgement]) -> list[Rate]:
        """Family by family."""
        found = []
        for family, visible, figure, test, bar in self.figures:
            some = [j for j in judged if j.family == family and visible in (None, j.visible)]
            kind = {None: family, True: f"{family}, visible", False: f"{family}, faint"}[visible]
            found.append(Rate(kind, figure, sum(map(test, some)), len(some), bar))
        return found

    @property
    def families(self) -> tuple[str, ...]:
        """Families in order."""
        return tuple(dict.fromkeys(family for family, *_ in self.figures))


FIRST = Questions(FIGURES, HARD, AGAIN, ("single",), (1.05, 1.2))
