"""Counts of what was right: rates with their intervals, held against what is wanted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

Bar: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Rate:
    """hits of n, with the 95 % interval of Wilson (1927).

    family : of which cases; bar : (lowest, highest) rate wanted, or None
    """

    family: str
    figure: str
    hits: int
    n: int
    bar: Bar | None = None

    @classmethod
    def of(cls, family: str, figure: str, hits: Iterable[bool], bar: Bar | None = None) -> Rate:
        """Of what was right and wrong, one by one."""
        each = list(hits)
        return cls(family, figure, sum(each), len(each), bar)

    @property
    def rate(self) -> float | None:
        """Share, None of nothing."""
        return self.hits / self.n if self.n else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Of the share."""
        from scipy.stats import binomtest

        if not self.n:
            return None
        low, high = binomtest(self.hits, self.n).proportion_ci(method="wilson")
        return float(low), float(high)

    @property
    def met(self) -> bool | None:
        """The interval reaches the bar."""
        interval = self.interval
        if self.bar is None or interval is None:
            return None
        return interval[1] >= self.bar[0] and interval[0] <= self.bar[1]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "rate": self.rate, "ci95": self.interval, "met": self.met}

    def row(self) -> dict[str, Any]:
        """For a table, shares in percent."""
        between = None
        if self.interval is not None:
            between = " to ".join(f"{100.0 * end:.1f}" for end in self.interval)
        return {
            "cases": self.family,
            "figure": self.figure,
            "count": f"{self.hits} of {self.n}",
            "[%]": None if self.rate is None else f"{100.0 * self.rate:.1f}",
            "95 % [%]": between,
            "wanted": wanted(self.bar),
            "met": {None: "", True: "yes", False: "no"}[self.met],
        }


def wanted(bar: Bar | None) -> str:
    """A bar in percent."""
    if bar is None:
        return ""
    low, high = (f"{100 * end:.0f}" for end in bar)
    if bar[0] == 0.0:
        return f"at most {high}"
    return f"at least {low}" if bar[1] == 1.0 else f"{low} to {high}"
