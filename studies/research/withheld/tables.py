"""The score in print: the figures against their bars, rivals beside them, then where they come from."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from studies.research.withheld.score import BINS

Row = dict[str, Any]
Scores = dict[str, dict[str, Any]]
"""Score of each program by its name, the first one judged against the bars."""

_BY_ANYONE = ("false alarms", "something found")  # figures of programs that name nothing, too
_NONE = "-"
_VERDICTS = ("no_gap", "explained", "ambiguous", "unknown", "none")


def show(console: Console, result: dict[str, Any]) -> None:
    """Print all tables of a score, each with what a reader must know of it."""
    scores = {result["program"]: result, **result["rivals"]}
    families = ", ".join(f"{n} {family}" for family, n in sorted(result["families"].items()))
    console.print(f"{result['cases']} sealed cases: {families}")
    for name, one in scores.items():
        median, ninth = (_ratio(one["seconds"][quantile]) for quantile in ("median", "p90"))
        console.print(
            f"  {name}: {one['failed']} without an answer; {median} s a case, ninth decile {ninth} s"
        )
    for table, note in (
        _figures(scores),
        _heldout(scores),
        _reliability(scores),
        _groups("Robot by robot", result["robots"]),
        _groups("Under each condition", result["conditions"]),
        _effects(result),
        _outside(result),
    ):
        console.print()
        console.print(table)
        for line in note:
            console.print(f"  {line}")


Part = tuple[Table, tuple[str, ...]]


def _table(title: str, *columns: str, words: int = 1) -> Table:
    """An empty table; ``words`` columns stand left, figures right."""
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", padding=(0, 1, 0, 0))
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index < words else "right", no_wrap=True)
    return table


def _figures(scores: Scores) -> Part:
    """Every figure of the first program with interval and bar, and the rate of each rival."""
    first, *rivals = scores
    columns = ("cases", "figure", "of", "bar", first, "95 %", "met", *rivals)
    table = _table("The same cases, program by program (rates in %)", *columns, words=2)
    before = None
    for rows in zip(*map(_rated, scores.values()), strict=True):
        own, family = rows[0], rows[0]["family"]
        if family != before:
            table.add_section()
        values = [_rate_of(score, row) for score, row in zip(scores.values(), rows, strict=True)]
        cells = [family if family != before else "", own["figure"], str(own["n"]), _bar(own["bar"])]
        table.add_row(*cells, values[0], _interval(own["ci95"]), _met(own["met"]), *values[1:])
        before = family
    return table, (
        "visible: noncentrality above 60 beside all that is modelled; faint: below.",
        "met: the 95 % interval reaches the bar. twin: another effect moves every marker alike.",
        f"{_NONE}: no such case, or the program names nothing. Intervals: of what each names rightly.",
    )


def _rated(score: dict[str, Any]) -> list[Row]:
    """Rates by family, and the coverage in the same form."""
    return [*score["rates"], {**score["coverage"], "figure": "95 % interval holds truth"}]


def _rate_of(score: dict[str, Any], row: Row) -> str:
    if row["rate"] is None or not (score["names"] or row["figure"] in _BY_ANYONE):
        return _NONE
    return f"{100 * row['rate']:.1f}"


def _heldout(scores: Scores) -> Part:
    """Median and ninth decile of held-out RMS over the floor, family by family and by robot."""
    first = next(iter(scores.values()))
    title = "Held-out RMS over the true floor, plans of at least 40 configurations"
    table = _table(title, "cases", "of", "model alone", *scores)
    for index, row in enumerate(first["heldout_by_family"]):
        name = row["family"] if row["family"] == "null" else f"{row['family']}, visible"
        rows = [score["heldout_by_family"][index] for score in scores.values()]
        table.add_row(name, str(row["n"]), _two(row, "before_"), *map(_two, rows))
    table.add_section()
    for index, row in enumerate(first["heldout_by_robot"]):
        rows = [score["heldout_by_robot"][index] for score in scores.values()]
        name = f"single, visible, {row['robot']}"
        table.add_row(name, str(row["n"]), _two(row, "before_"), *map(_two, rows))
    floor = first["heldout_over_floor"]
    fitted = (
        f"Over what a fit of the true visible causes to the same data leaves: {_two(floor, 'reach_')}.",
    )
    note = "Median, and ninth decile after the stroke. 1 is the noise itself; a failed run is infinite."
    if not floor["n"]:
        return table, (note,)
    return table, (note, *_floor_bars(floor), *(fitted if len(floor["families"]) > 1 else ()))


def _floor_bars(floor: Row) -> tuple[str, ...]:
    families, (median, ninth) = ", ".join(floor["families"]), floor["bars"]
    return (
        f"Bars, {families} visible: median at most {median:g}, is {_ratio(floor['median'])} "
        f"({_range(floor['median_ci95'])}); ninth decile at most {ninth:g}, is",
        f"{_ratio(floor['p90'])} ({_range(floor['p90_ci95'])}); met: {_met(floor['met'])}.",
    )


def _two(row: Row, prefix: str = "") -> str:
    if not row["n"]:
        return _NONE
    return f"{_ratio(row[f'{prefix}median'])} / {_ratio(row[f'{prefix}p90'])}"


def _reliability(scores: Scores) -> Part:
    """Of effects named with some probability, how many are there."""
    naming = {name: score for name, score in scores.items() if score["names"]}
    columns = [column for name in naming for column in (name, "95 %")]
    table = _table("Are stated probabilities right? (in %)", "stated", *columns)
    for index, (low, high) in enumerate(pairwise(BINS)):
        cells = []
        for score in naming.values():
            row = score["reliability"][index]
            cells += [_counted(row), _interval(row["ci95"])]
        table.add_row(f"{100 * low:g} to {100 * high:g}", *cells)
    return table, ("Right, of all effects that were named with such a probability.",)


_HEADS = {
    "false alarms": "null:\nfalse alarms",
    "named exactly": "single:\nexactly",
    "within its class": "single:\nin class",
    "located": "single:\nlocated",
    "both found": "pair:\nboth found",
    "unknown and located": "outside:\nunknown and\nlocated",
    "right cause listed": "shape:\nright cause\nlisted",
    "cause found": "mixture:\neach cause",
    "joint found": "whole:\neach joint",
}


def _groups(title: str, rows: list[Row]) -> Part:
    """One line a group, one column a figure."""
    asked = {row["figure"] for row in rows}
    heads = {figure: head for figure, head in _HEADS.items() if figure in asked}
    table = _table(f"{title} (in %; visible causes)", "", *heads.values())
    for name in dict.fromkeys(row["family"] for row in rows):
        own = {row["figure"]: row for row in rows if row["family"] == name}
        table.add_row(name, *(_counted(own[figure]) for figure in heads))
    return table, ()


def _effects(result: dict[str, Any]) -> Part:
    """Effect by effect: found within the class, and intervals that hold the truth."""
    found: dict[str, dict[str, Row]] = {"single": {}}
    for row in result["causes"]:
        if row["family"] != "outside":
            found.setdefault(row["family"], {})[row["figure"]] = row
    held = {row["figure"]: row for row in result["coverage_by_effect"]}
    table = _table("Effect by effect (in %)", "effect", *found, "intervals hold", "95 %")
    for effect in sorted({*held, *(name for rows in found.values() for name in rows)}):
        cells = [_counted(rows[effect]) if effect in rows else _NONE for rows in found.values()]
        table.add_row(effect, *cells, *_both(held.get(effect)))
    return table, (
        "Visible causes found within their class. Intervals: of all rightly named ones.",
    )


def _outside(result: dict[str, Any]) -> Part:
    """Causes outside the catalogue: what is right, and every verdict."""
    columns = ("cause", "unknown, located", "95 %", *_VERDICTS)
    table = _table("Causes outside the catalogue (in %; visible; verdicts counted)", *columns)
    for row in result["causes"]:
        if row["family"] == "outside":
            counts = result["outside_verdicts"][row["figure"]]
            table.add_row(row["figure"], *_both(row), *(str(counts.get(v, 0)) for v in _VERDICTS))
    return table, (
        "What the catalogue came to hold may be named as well: jumps, a third harmonic.",
    )


def _both(row: Row | None) -> tuple[str, str]:
    return (_NONE, "") if row is None else (_counted(row), _interval(row["ci95"]))


def _counted(row: Row) -> str:
    return _NONE if row["rate"] is None else f"{100 * row['rate']:.1f} of {row['n']}"


def _bar(bar: tuple[float, float] | None) -> str:
    if bar is None:
        return ""
    low, high = (f"{100 * end:.0f}" for end in bar)
    if bar[0] == 0.0:
        return f"max {high}"
    return f"min {low}" if bar[1] == 1.0 else f"{low} to {high}"


def _interval(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else f"{100 * interval[0]:.1f} to {100 * interval[1]:.1f}"


def _met(met: bool | None) -> str:
    return {None: "", True: "yes", False: "no"}[met]


def _ratio(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.2f}"


def _range(interval: list[float | None]) -> str:
    return " to ".join(_ratio(value) for value in interval)
