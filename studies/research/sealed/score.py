"""The score of many answers: which figures are asked of which family, with bars, and their print."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

from studies.research.bench import table
from studies.research.rates import Bar, Rate
from studies.research.sealed.judge import CONFIDENT, Judgement, judged_or_failed
from studies.research.sealed.seal import opened

BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
MANY = 40  # configurations of a plan from which held-out errors are held against the floor
Row = dict[str, Any]
# family, visible only, figure, test, bar
Figure: TypeAlias = tuple[str, bool | None, str, Callable[[Judgement], bool], Bar | None]
_ALARMS: Figure = ("null", None, "false alarms", lambda j: j.alarm, (0.0, 0.04))
_UNKNOWN: Figure = (
    "outside", True, "unknown and located", lambda j: j.unknown_located, (0.85, 1.0)
)  # fmt: skip
_MOST_WRONG: Bar = (0.0, 0.03)


def _misnamed(family: str, visible: bool | None = True) -> Figure:
    return family, visible, "confidently misnamed", lambda j: j.sure_wrong, _MOST_WRONG


def _one_cause(family: str, exact: Bar | None, located: float) -> tuple[Figure, ...]:
    return (
        (family, True, "named exactly", lambda j: j.exact, exact),
        (family, True, "within its class", lambda j: j.found, (0.93, 1.0)),
        (family, True, "located", lambda j: j.located, (located, 1.0)),
    )


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
    mixed, whole = (
        [c.found for j in judged if j.family == family for c in j.causes if c.visible]
        for family in ("mixture", "whole")
    )
    both = [j for j in judged if j.answered and math.isfinite(j.before_over_floor)]
    rose = [not j.over_floor <= j.before_over_floor * (1.0 + 1e-6) for j in both]
    stated = [own for j in judged for own in j.statements]
    sure = [right for p, right in stated if p >= CONFIDENT]
    near = [right for p, right in stated if 0.925 <= p < 0.975]
    wrong = [j.sure_wrong for j in judged]
    return [
        Rate.of("mixture, each visible cause", "cause found", mixed, (0.75, 1.0)),
        Rate.of("whole, each visible joint", "joint found", whole),
        Rate.of("all", "held-out after above before", rose, (0.0, 0.01)),
        Rate.of("all", "confidently misnamed", wrong, _MOST_WRONG),
        Rate.of("names", "given 0.90 or more, right", sure),
        Rate.of("names", "given 0.925 to 0.975, right", near, (0.93, 0.97)),
    ]


FIRST = Questions(
    (
        _ALARMS,
        *_one_cause("single", (0.85, 1.0), 0.93),
        ("single", True, "called explained", lambda j: j.explained, None),
        ("pair", True, "both found", lambda j: j.found, (0.75, 1.0)),
        _UNKNOWN,
        ("outside", True, "confidently misnamed", lambda j: j.misnamed, (0.0, 0.04)),
        ("shape", True, "right cause listed", lambda j: j.found, (0.85, 1.0)),
        ("shape", True, "called explained", lambda j: j.explained, (0.0, 0.10)),
    ),
    ("single",),
    (1.05, 1.2),
)
REAL = Questions(
    (
        _ALARMS,
        _misnamed("null", None),
        *_one_cause("single", None, 0.95),
        _misnamed("single"),
        _misnamed("single", False),
        _misnamed("mixture"),
        ("whole", True, "its kind named", _kind_named, None),
        _misnamed("whole"),
        _UNKNOWN,
        _misnamed("outside"),
    ),
    ("single", "mixture", "whole"),
    (1.06, 1.2),
    _of_real_arms,
)


def score(folder: Path) -> Row:
    """The whole score of a folder, as written to JSON. Raises BrokenSeal."""
    keys, runs, answers = opened(folder)
    judged = [judged_or_failed(keys[name], answer) for name, answer in answers.items()]
    drawn = {key.get("draw") for key in keys.values()}
    asked = REAL if "real arms" in drawn else FIRST
    return {
        "schema": 1,
        "command": "sealed score",
        "cases": len(judged),
        "families": Counter(j.family for j in judged),
        "failed": sum(not j.answered for j in judged),
        "seconds": _quantiles([run["seconds"] for run in runs.values()]),
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
    before = _quantiles([j.before_over_floor for j in some])
    found |= {"before_median": before["median"], "before_p90": before["p90"]}
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


def shown(result: Row) -> Iterator[Any]:
    """What is printed of a score: each figure against its bar, probabilities, held-out errors."""
    families = ", ".join(f"{n} {family}" for family, n in sorted(result["families"].items()))
    seconds, floor = result["seconds"], result["heldout_over_floor"]
    yield (
        f"{result['cases']} sealed cases: {families}\n{result['failed']} without an answer; "
        f"{seconds['median']:.2f} s a case, ninth decile {seconds['p90']:.2f} s\n"
    )
    yield table(_rate(row).row() for row in (*result["rates"], result["coverage"]))
    yield "\nvisible: noncentrality above 60 beside all that is modelled; faint: below."
    yield "Of effects named with some probability, how many are there:\n"
    yield table(_rate(row).row() for row in result["reliability"])
    yield "\nHeld-out RMS over the true floor, plans of at least 40 configurations\n"
    told = {"cases": floor["n"], "before": floor["before_median"]}
    for key, bar in zip(("median", "p90"), floor["bars"], strict=True):
        told |= {key: floor[key], f"95 %, {key}": _between(floor[f"{key}_ci95"]), f"{key} bar": bar}
    yield table([told])


def _rate(row: Row) -> Rate:
    return Rate(*(row[name] for name in ("family", "figure", "hits", "n", "bar")))


def _between(ends: Sequence[float | None] | None) -> str | None:
    if ends is None:
        return None
    return " to ".join("infinite" if end is None else f"{end:.2f}" for end in ends)
