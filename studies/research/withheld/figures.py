"""Rates with Wilson intervals, and which figures are asked of which family, with their bars."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, TypeAlias

from studies.research.withheld.judge import CONFIDENT, CauseJudged, Judgement

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
    ("single", True, "named exactly", lambda j: j.exact, (0.85, 1.0)),
    ("single", True, "within its class", lambda j: j.found, (0.93, 1.0)),
    ("single", True, "located", lambda j: j.located, (0.93, 1.0)),
    ("single", True, "called explained", lambda j: j.explained, None),
    ("pair", True, "both found", lambda j: j.found, (0.75, 1.0)),
    ("outside", True, "unknown and located", lambda j: j.unknown_located, (0.85, 1.0)),
    ("outside", True, "confidently misnamed", lambda j: j.misnamed, (0.0, 0.04)),
    ("shape", True, "right cause listed", lambda j: j.found, (0.85, 1.0)),
    ("shape", True, "called explained", lambda j: j.explained, (0.0, 0.10)),
)


@dataclass(frozen=True)
class Questions:
    """What is asked of a set of cases.

    figures : family by family
    floors, floor_bars : families whose held-out errors are held against the floor; largest median
        and ninth decile wanted
    """

    figures: tuple[Figure, ...]
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


FIRST = Questions(FIGURES, ("single",), (1.05, 1.2))


_REAL_FIGURES: tuple[Figure, ...] = (
    ("null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04)),
    ("null", None, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("single", True, "named exactly", lambda j: j.exact, None),
    ("single", True, "within its class", lambda j: j.found, (0.93, 1.0)),
    ("single", True, "located", lambda j: j.located, (0.95, 1.0)),
    ("single", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("single", False, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("mixture", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("whole", True, "its kind named", lambda j: _kind_named(j), None),
    ("whole", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
    ("outside", True, "unknown and located", lambda j: j.unknown_located, (0.85, 1.0)),
    ("outside", True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
)
_EACH = "mixture, each visible cause"
_JOINT = "whole, each visible joint"


@dataclass(frozen=True)
class _Real(Questions):
    def rates(self, judged: Sequence[Judgement]) -> list[Rate]:
        return [*super().rates(judged), *_each(judged), *_overall(judged)]


REAL = _Real(_REAL_FIGURES, ("single", "mixture", "whole"), (1.06, 1.2))


def _each(judged: Sequence[Judgement]) -> list[Rate]:
    """Causes of mixtures and joints of whole arms, one by one, by class membership."""
    mixed, joints = _causes(judged, "mixture"), _causes(judged, "whole")
    return [
        _found(_EACH, "cause found", mixed, (0.75, 1.0)),
        _found(_JOINT, "joint found", joints),
    ]


def _overall(judged: Sequence[Judgement]) -> list[Rate]:
    """What holds for all cases together: held-out errors that rose, names that were sure."""
    both = [j for j in judged if j.answered and j.before_over_floor < float("inf")]
    rose = sum(not j.over_floor <= j.before_over_floor * (1.0 + 1e-6) for j in both)
    sure = [right for j in judged for p, right in j.statements if p >= CONFIDENT]
    near = [right for j in judged for p, right in j.statements if 0.925 <= p < 0.975]
    return [
        Rate("all", "held-out after above before", rose, len(both), (0.0, 0.01)),
        Rate(
            "all",
            "confidently misnamed",
            sum(j.sure_wrong for j in judged),
            len(judged),
            (0.0, 0.03),
        ),
        Rate("names", "given 0.90 or more, right", sum(sure), len(sure)),
        Rate("names", "given 0.925 to 0.975, right", sum(near), len(near), (0.93, 0.97)),
    ]


def _causes(judged: Iterable[Judgement], family: str) -> list[CauseJudged]:
    return [c for j in judged if j.family == family for c in j.causes if c.visible]


def _found(family: str, figure: str, causes: Sequence[CauseJudged], bar: Bar | None = None) -> Rate:
    return Rate(family, figure, sum(c.found for c in causes), len(causes), bar)


def _kind_named(j: Judgement) -> bool:
    kind = j.truth[0].partition(":")[0]
    return any(name.partition(":")[0] == kind for name in j.named)


DRAWN = "other instruments"
READERS = ("world camera", "tip camera", "pose", "distance", "socket")

_READ_FIGURES: tuple[Figure, ...] = (
    ("null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04)),
    *(
        own
        for family in ("single", "instrument")
        for own in (
            (family, True, "named exactly", lambda j: j.exact, None),
            (family, True, "within its class", lambda j: j.found, (0.93, 1.0)),
            (family, True, "located", lambda j: j.located, (0.93, 1.0)),
            (family, True, "confidently misnamed", lambda j: j.sure_wrong, (0.0, 0.03)),
        )
    ),
)
SENSED = Questions(_READ_FIGURES, ("single", "instrument"), (1.05, 1.2))
