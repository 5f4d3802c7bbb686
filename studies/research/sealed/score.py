"""The score of many answers: which figures are asked of which family, with bars, and their print."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

from rich.console import Console

from studies.research.bench import table
from studies.research.sealed.judge import CONFIDENT, Judgement, judged_or_failed
from studies.research.sealed.seal import Answered, opened

BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
MANY = 40  # configurations of a plan from which held-out errors are held against the floor
SENSED = "other instruments"
Bar: TypeAlias = tuple[float, float]
Test: TypeAlias = Callable[[Judgement], bool]
Row = dict[str, Any]


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

    @classmethod
    def of(cls, family: str, figure: str, hits: Iterable[bool], bar: Bar | None = None) -> Rate:
        """Of what was right and wrong, one by one."""
        each = list(hits)
        return cls(family, figure, sum(each), len(each), bar)

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

    def as_dict(self) -> Row:
        """For JSON."""
        return {**asdict(self), "rate": self.rate, "ci95": self.interval, "met": self.met}


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % interval of a share."""
    from scipy.stats import binomtest

    low, high = binomtest(hits, n).proportion_ci(method="wilson")
    return float(low), float(high)


# family, visible only, figure, test, bar
Figure: TypeAlias = tuple[str, bool | None, str, Test, Bar | None]
_MOST_WRONG: Bar = (0.0, 0.03)


def _alarms() -> Figure:
    return "null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04)


def _misnamed(family: str, visible: bool | None = True) -> Figure:
    return family, visible, "confidently misnamed", lambda j: j.sure_wrong, _MOST_WRONG


def _one_cause(family: str, exact: Bar | None, located: float) -> tuple[Figure, ...]:
    return (
        (family, True, "named exactly", lambda j: j.exact, exact),
        (family, True, "within its class", lambda j: j.found, (0.93, 1.0)),
        (family, True, "located", lambda j: j.located, (located, 1.0)),
    )


def _unknown() -> Figure:
    return "outside", True, "unknown and located", lambda j: j.unknown_located, (0.85, 1.0)


def _kind_named(j: Judgement) -> bool:
    kind = j.truth[0].partition(":")[0]
    return any(name.partition(":")[0] == kind for name in j.named)


@dataclass(frozen=True)
class Questions:
    """What is asked of a set of cases.

    figures : family by family; more : of all cases together
    floors, floor_bars : families whose held-out errors are held against the floor; largest median
        and ninth decile wanted
    """

    figures: tuple[Figure, ...]
    floors: tuple[str, ...]
    floor_bars: tuple[float, float]
    more: Callable[[Sequence[Judgement]], list[Rate]] = lambda _: []

    def rates(self, judged: Sequence[Judgement]) -> list[Rate]:
        """Family by family."""
        found = []
        for family, visible, figure, test, bar in self.figures:
            some = [j for j in judged if j.family == family and visible in (None, j.visible)]
            kind = {None: family, True: f"{family}, visible", False: f"{family}, faint"}[visible]
            found.append(Rate.of(kind, figure, map(test, some), bar))
        return [*found, *self.more(judged)]


def _of_real_arms(judged: Sequence[Judgement]) -> list[Rate]:
    """Causes one by one; held-out errors that rose, names that were sure."""
    each = {
        family: [c.found for j in judged if j.family == family for c in j.causes if c.visible]
        for family in ("mixture", "whole")
    }
    both = [j for j in judged if j.answered and math.isfinite(j.before_over_floor)]
    rose = [not j.over_floor <= j.before_over_floor * (1.0 + 1e-6) for j in both]
    stated = [own for j in judged for own in j.statements]
    sure = [right for p, right in stated if p >= CONFIDENT]
    near = [right for p, right in stated if 0.925 <= p < 0.975]
    wrong = [j.sure_wrong for j in judged]
    return [
        Rate.of("mixture, each visible cause", "cause found", each["mixture"], (0.75, 1.0)),
        Rate.of("whole, each visible joint", "joint found", each["whole"]),
        Rate.of("all", "held-out after above before", rose, (0.0, 0.01)),
        Rate.of("all", "confidently misnamed", wrong, _MOST_WRONG),
        Rate.of("names", "given 0.90 or more, right", sure),
        Rate.of("names", "given 0.925 to 0.975, right", near, (0.93, 0.97)),
    ]


FIRST = Questions(
    (
        _alarms(),
        *_one_cause("single", (0.85, 1.0), 0.93),
        ("single", True, "called explained", lambda j: j.explained, None),
        ("pair", True, "both found", lambda j: j.found, (0.75, 1.0)),
        _unknown(),
        ("outside", True, "confidently misnamed", lambda j: j.misnamed, (0.0, 0.04)),
        ("shape", True, "right cause listed", lambda j: j.found, (0.85, 1.0)),
        ("shape", True, "called explained", lambda j: j.explained, (0.0, 0.10)),
    ),
    ("single",),
    (1.05, 1.2),
)
REAL = Questions(
    (
        _alarms(),
        _misnamed("null", None),
        *_one_cause("single", None, 0.95),
        _misnamed("single"),
        _misnamed("single", False),
        _misnamed("mixture"),
        ("whole", True, "its kind named", _kind_named, None),
        _misnamed("whole"),
        _unknown(),
        _misnamed("outside"),
    ),
    ("single", "mixture", "whole"),
    (1.06, 1.2),
    _of_real_arms,
)
OTHERS = Questions(
    (
        _alarms(),
        *_one_cause("single", None, 0.93),
        _misnamed("single"),
        *_one_cause("instrument", None, 0.93),
        _misnamed("instrument"),
    ),
    ("single", "instrument"),
    (1.05, 1.2),
)


def score(folder: Path) -> Row:
    """The whole score of a folder, as written to JSON. Raises BrokenSeal.

    At the top that of the first program, the diagnosis where it answered; the others as ``rivals``.
    """
    keys, answered = opened(folder)
    first, *others = answered
    return {
        "schema": 1,
        "command": "sealed score",
        "program": first,
        **score_of(keys, answered[first]),
        "rivals": {name: score_of(keys, answered[name]) for name in others},
    }


def score_of(keys: Row, answered: Answered) -> Row:
    """The score of one program."""
    judged = [judged_or_failed(keys[name], answer) for name, answer in answered.answers.items()]
    drawn = {key.get("draw") for key in keys.values()}
    asked = REAL if "real arms" in drawn else OTHERS if SENSED in drawn else FIRST
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


def reliability(judged: Iterable[Judgement]) -> list[Row]:
    """How often named effects are right, by the probability that the answer gives them."""
    stated, rows = [s for j in judged for s in j.statements], []
    for low, high in pairwise(BINS):
        some = [s for s in stated if low < s[0] <= high or (low == 0.0 == s[0])]
        mean = sum(p for p, _ in some) / len(some) if some else None
        rate = Rate.of(f"{low:g} to {high:g}", "right", (right for _, right in some))
        rows.append({**rate.as_dict(), "stated": mean})
    return rows


def coverage(judged: Iterable[Judgement]) -> Rate:
    """95 % intervals of the parameters of rightly named effects, singles and pairs."""
    held = (inside for j in judged for inside in j.intervals)
    return Rate.of("parameters", "truth within 1.96 std", held, (0.93, 0.97))


def floors(judged: Iterable[Judgement], asked: Questions = FIRST) -> Row:
    """Held-out RMS after over the true floor: visible effects, at least 40 configurations."""
    many = [j for j in judged if j.conditions["configurations"] >= MANY]
    some = [j for j in many if j.family in asked.floors and j.visible]
    found = _quantiles([j.over_floor for j in some])
    for name, values in (
        ("before", [j.before_over_floor for j in some]),
        ("reach", [j.over_reach for j in some]),
    ):
        other = _quantiles(values)
        found |= {f"{name}_median": other["median"], f"{name}_p90": other["p90"]}
    lows = [ends[0] if ends else None for ends in (found["median_ci95"], found["p90_ci95"])]
    reached = all(
        low is not None and low <= bar for low, bar in zip(lows, asked.floor_bars, strict=True)
    )
    bars = {"families": list(asked.floors), "bars": list(asked.floor_bars)}
    return {**found, **bars, "met": reached if found["n"] else None}


def _quantiles(values: Sequence[float]) -> Row:
    """Median and ninth decile with distribution-free intervals; null stands for infinite."""
    from scipy.stats import binom

    ordered, n = sorted(values), len(values)
    found: Row = {"n": n}
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


def _short(j: Judgement) -> Row:
    names = ["case", "family", "robot", "truth", "noncentrality", "visible", "verdict", "named"]
    shown = {name: getattr(j, name) for name in (*names, "exact", "found", "located", "misnamed")}
    ends = {name: _finite(getattr(j, name)) for name in ("before_over_floor", "over_floor")}
    faint = [cause.name for cause in j.causes if not cause.visible]
    return {**shown, **ends, "faint": faint, "missed": [c.name for c in j.causes if not c.found]}


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
    rated = ([*s["rates"], {**s["coverage"], "figure": "95 % interval holds truth"}]
             for s in scores.values())  # fmt: skip
    console.print(table(_figure(scores, rows) for rows in zip(*rated, strict=True)))
    console.print("  visible: noncentrality above 60 beside all that is modelled; faint: below.")
    console.print("\nOf effects named with some probability, how many are there (in %)")
    naming = {name: one for name, one in scores.items() if one["names"]}
    bins = zip(*(one["reliability"] for one in naming.values()), strict=True)
    console.print(table(_stated(dict(zip(naming, rows, strict=True))) for rows in bins))
    console.print("\nHeld-out RMS over the true floor, plans of at least 40 configurations")
    console.print(table(_heldout(name, one["heldout_over_floor"]) for name, one in scores.items()))


def _figure(scores: dict[str, Row], rows: Sequence[Row]) -> Row:
    """A figure of the first program with interval and bar, and the rate of each rival."""
    own, (first, *rivals) = rows[0], scores
    shown = {name: _percent(scores[name], row) for name, row in zip(scores, rows, strict=True)}
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


def _percent(score: Row, row: Row) -> str:
    """A rate; of programs that name nothing that of false alarms alone."""
    if row["rate"] is None or not (score["names"] or row["figure"] == "false alarms"):
        return "-"
    return f"{100 * row['rate']:.1f}"


def _stated(rows: dict[str, Row]) -> Row:
    """Of effects that were named with a probability within these bounds, how many are there."""
    found: Row = {"stated": next(iter(rows.values()))["family"]}
    for name, row in rows.items():
        counted = "-" if row["rate"] is None else f"{100 * row['rate']:.1f} of {row['n']}"
        found |= {name: counted, f"95 %, {name}": _interval(row["ci95"])}
    return found


def _heldout(name: str, floor: Row) -> Row:
    """Median and ninth decile against their bars."""
    found: Row = {"program": name, "cases": floor["n"]}
    if floor["n"]:
        for key, bar in zip(("median", "p90"), floor["bars"], strict=True):
            low, high = map(_ratio, floor[f"{key}_ci95"])
            found |= {key: f"{_ratio(floor[key])} ({low} to {high})", f"{key} bar": f"{bar:g}"}
        for key in ("before", "reach"):
            found[f"{key}, median"] = _ratio(floor[f"{key}_median"])
    return found


def _bar(bar: Bar | None) -> str:
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
