"""The score in print."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table


def show(console: Console, result: dict[str, Any]) -> None:
    """Print all tables of a score."""
    seconds = result["seconds"]
    console.print(
        f"{result['cases']} cases, {result['failed']} without an answer; seconds a case: median "
        f"{_number(seconds['median'])}, ninth decile {_number(seconds['p90'])}"
    )
    console.print(_rates("By family", result["rates"]))
    console.print(_rates("Under each condition", result["conditions"]))
    console.print(_rates("By cause, visible: in class, or unknown and located", result["causes"]))
    console.print(_rates("Parameters", [result["coverage"]]))
    console.print(_reliability(result["reliability"]))
    floor = result["heldout_over_floor"]
    console.print(
        f"held-out RMS after over the true floor ({floor['n']} single visible effects, at least 40 "
        f"configurations): median {_number(floor['median'])} {_range(floor['median_ci95'])}, bar 1.05; "
        f"ninth decile {_number(floor['p90'])} {_range(floor['p90_ci95'])}, bar 1.2"
    )


def _rates(title: str, rows: list[dict[str, Any]]) -> Table:
    table = Table("family", "figure", "hits", "of", "rate", "95 %", "bar", "met", title=title)
    for row in rows:
        bar = f"{row['bar'][0]:.0%} to {row['bar'][1]:.0%}" if row["bar"] else ""
        met = {None: "", True: "yes", False: "no"}[row["met"]]
        cells = [row["family"], row["figure"], str(row["hits"]), str(row["n"])]
        table.add_row(*cells, _share(row["rate"]), _shares(row["ci95"]), bar, met)
    return table


def _reliability(rows: list[dict[str, Any]]) -> Table:
    table = Table("stated", "mean", "right", "of", "rate", "95 %", title="Named effects")
    for row in rows:
        cells = [row["family"], _share(row["stated"]), str(row["hits"]), str(row["n"])]
        table.add_row(*cells, _share(row["rate"]), _shares(row["ci95"]))
    return table


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def _shares(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else f"{interval[0]:.3f} to {interval[1]:.3f}"


def _number(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.3f}"


def _range(interval: list[float | None] | None) -> str:
    return "" if interval is None else f"({' to '.join(_number(v) for v in interval)})"
