"""Optimal plans: cost of posecal's own parts, and other programs on the same information blocks.

    python -m studies.research.benchmarks.design [--quick] [--only PART] [--out FOLDER] [--peers PYTHON]

The robot is the demo's KR 270 with three markers. Its elastostatic problem (p = 9, five levels of A2
with three poses each) is the paper's; the geometric one has p = 33. Every case runs in a process of its
own with one thread of linear algebra; times are medians of up to three runs. "certified gap" is the
proved bound over the value of the weighted plan, "efficiency" the value of the whole plan over that
bound, "median start" the share of that value that the starts of the search end at.
Peers are timed without the making of the blocks:

- FIGAROH's Detmax, from three random starts (``pip install figaroh==1.0.2``);
- pydex's D-optimal efforts, its sensitivities given to it (``pip install pydex==0.0.9``);
- R's AlgDesign and OptimalDesign, which know only one row per candidate: rows drawn from the blocks.

``--peers`` names an interpreter that has the first two, this one if none is given.
"""

from __future__ import annotations

import os
import platform
import statistics
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import click
from rich.console import Console
from rich.table import Column, Table

from calib.files.write import json_text, write_files
from studies.command.options import one_line_faults
from studies.research.benchmarks.design_runs import Row, in_child

CRITERIA = ("D", "A", "task")
STOP = 120.0  # seconds after which a run of one master is stopped
MB_OF_GOAL = 2000.0


def scaling(quick: bool) -> tuple[list[Row], list[Row]]:
    """Pools, and what was solved on them, of the paper's problem."""
    pools, solved = [], []
    for case in ("paper", "paper, no masses"):
        for count in (1000, 10_000) if quick else (1000, 10_000, 100_000, 1_000_000):
            found = in_child("scaling", case=case, count=count, criteria=list(CRITERIA))
            assert found is not None  # noqa: S101
            rows = found.pop("solved")
            pools.append({"case": case, **found})
            solved += [{"case": case, "candidates": count, **row} for row in rows]
    return pools, solved


def by_parameters(quick: bool) -> Iterator[Row]:
    """Relaxation by each master program."""
    cases = {"elastic": 9, "elastic + base": 15, "elastic + base, tool": 24}
    cases |= {} if quick else {"geometric": 33, "all": 42}
    for case, p in cases.items():
        sizes = [1000] if quick else [1000, 10_000, *([100_000] if p == 9 else [])]
        for count in sizes:
            for criterion in ("D", "task"):
                for by in ("conic", "interior point"):
                    head = {"p": p, "model": case, "candidates": count, "criterion": criterion}
                    found = in_child(
                        "parameters", STOP, case=case, count=count, criterion=criterion, by=by
                    )
                    found = found or {"seconds": None, "rounds": None, "certified gap": None}
                    yield {**head, "master": by, **found}


def branches(quick: bool) -> Iterator[Row]:
    """Branch and bound to its end: five levels of the paper, and twenty poses without."""
    for case in ("paper", "elastic"):
        for criterion in CRITERIA:
            for count in (300,) if quick else (1000, 10_000, 100_000):
                head = {"case": case, "criterion": criterion, "candidates": count}
                found = in_child("branch", STOP, case=case, count=count, criterion=criterion)
                yield {**head, **(found or {})}


def efficiencies(quick: bool) -> Iterator[Row]:
    """Whole plans of the geometric problem."""
    for criterion in ("D", "task"):
        count = 1000 if quick else 10_000
        found = in_child("efficiency", case="geometric", count=count, criterion=criterion)
        yield {"criterion": criterion, "candidates": count, **(found or {})}


def commands(quick: bool) -> Iterator[Row]:
    """The whole command on the paper's case."""
    for criterion in CRITERIA:
        yield in_child("command", criterion=criterion, candidates=2000 if quick else 100_000) or {}


def goals(found: dict[str, list[Row]]) -> list[Row]:
    """What is to be reached, and what was."""
    rows: list[Row] = []

    def add(goal: str, values: list[float], limit: float, at_most: bool = True) -> None:
        if values:
            worst = max(values) if at_most else min(values)
            met = worst <= limit if at_most else worst >= limit
            sign = "<=" if at_most else ">="
            rows.append(
                {
                    "goal": goal,
                    "limit": f"{sign} {limit:g}",
                    "worst": worst,
                    "met": "yes" if met else "no",
                }
            )

    for count, limit in ((100_000, 1.0), (1_000_000, 2.0)):
        own = [r for r in found["solved"] if r["candidates"] == count]
        add(f"relaxation, p 9, {count:.0e} [s]", [r["relaxation [s]"] for r in own], limit)
        add(f"its certified gap, {count:.0e}", [r["certified gap"] for r in own], 1e-4)
    million = [r for r in found["pools"] if r["candidates"] == 1_000_000]
    add("pool of 1e6 [s]", [r["pool [s]"] for r in million], 10.0)
    add("pool of 1e6, peak [MB]", [r["pool, peak [MB]"] for r in million], MB_OF_GOAL)
    full = [r for r in found["command"] if r["candidates"] == 100_000]
    add("posecal design, 1e5 candidates [s]", [r["seconds"] for r in full], 6.0)
    for criterion, limit in (("D", 0.99), ("task", 0.98)):
        own = [
            r for r in found["solved"] if (r["candidates"], r["criterion"]) == (100_000, criterion)
        ]
        add(f"efficiency of {criterion}, p 9, 1e5", [r["efficiency"] for r in own], limit, False)
    for criterion, limit in (("D", 0.93), ("task", 0.92)):
        own = [
            r
            for r in found["geometric"]
            if (r["candidates"], r["criterion"]) == (10_000, criterion)
        ]
        add(f"efficiency of {criterion}, p 33, 1e4", [r["efficiency"] for r in own], limit, False)
    for count in (1000, 10_000):
        proofs = [
            float(r.get("optimal", False)) for r in found["branch"] if r["candidates"] == count
        ]
        add(f"proved optimal at {count} (1 yes)", [min(proofs)] * bool(proofs), 1.0, False)
    peers = [r for r in found["peers"] if r["program"].startswith("figaroh")]
    for row in (r for r in found["peers"] if peers and r["task"] == peers[0]["task"]):
        if row["program"] != "posecal" or row["way"].endswith("allowed"):
            continue
        theirs = statistics.median(r["seconds"] for r in peers)
        best = max(r["det(M)^(1/p)"] for r in peers)
        add(f"faster than Detmax: {row['way']}", [theirs / row["seconds"]], 10.0, False)
        add(f"value over Detmax's best: {row['way']}", [row["det(M)^(1/p)"] / best], 1.0, False)
    return rows


def table(rows: list[Row], title: str) -> Table:
    """Rows under their headings, units on a line of their own."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    texts = {key for row in rows for key in keys if isinstance(row.get(key), str)}
    columns = (
        Column(k.replace(" [", "\n["), justify="left" if k in texts else "right") for k in keys
    )
    shown = Table(*columns, box=None, pad_edge=False, title=title, title_justify="left")
    for row in rows:
        shown.add_row(*(_cell(row.get(key)) for key in keys))
    return shown


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_cell(part)}" for key, part in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _plots(found: dict[str, list[Row]], folder: Path) -> None:
    from studies.research.benchmarks import design_plots as plots

    folder.mkdir(parents=True, exist_ok=True)
    figure = plots.cost_by_candidates(found["pools"], found["solved"], "paper")
    written = [*plots.save(figure, folder / "cost_by_candidates")]
    written += plots.save(
        plots.cost_by_parameters(found["by_parameters"], STOP), folder / "cost_by_p"
    )
    click.echo(f"wrote {', '.join(map(str, written))}")


PARTS = {
    "command": (commands, "posecal design on the paper's case, a whole process"),
    "geometric": (efficiencies, "Whole plans of the geometric problem"),
    "branch": (branches, "Branch and bound on the paper's case"),
    "by_parameters": (by_parameters, f"Relaxation by master, - where stopped after {STOP:g} s"),
}


@click.command()
@click.option("--quick", is_flag=True, help="Small sizes: does it run?")
@click.option("--only", multiple=True, type=click.Choice(list(PARTS)), help="These parts alone.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for JSON, PNG and SVG.")
@click.option("--peers", "python", metavar="PYTHON", default=sys.executable,
              help="Interpreter that has figaroh and pydex.")  # fmt: skip
@one_line_faults
def main(quick: bool, only: tuple[str, ...], out: Path | None, python: str) -> None:
    """Measure the design of plans; the full run takes about twenty minutes."""
    console = Console(width=165, highlight=False, markup=False)
    load = os.getloadavg()
    found: dict[str, list[Row]] = {}
    if not only:
        found["pools"], found["solved"] = scaling(quick)
        console.print(table(found["pools"], "Candidates with blocks, memory of the whole process"))
        console.print(table(found["solved"], "\nRelaxation and exchange on them"))
    for name in only or PARTS:
        measure, title = PARTS[name]
        found[name] = list(measure(quick))
        console.print(table(found[name], "\n" + title))
    if only:
        return
    from studies.research.benchmarks.design_peers import compare

    peers = compare(python, quick)
    found["peers"] = peers.rows
    console.print(table(found["peers"], "\nOther programs on the same blocks"))
    for line in peers.skipped:
        console.print(line)
    found["goals"] = goals(found)
    console.print(table(found["goals"], "\nGoals"))
    if out is not None:
        _plots(found, out)
        named = ("posecal", "numpy", "scipy", "cvxpy", "clarabel")
        run: Row = {"python": platform.python_version(), "platform": platform.platform()}
        versions = {name: version(name) for name in named}
        fields: Row = {
            "run": {**run, **versions, "cores": os.cpu_count(), "load": load, "quick": quick},
            **found,
            "skipped": peers.skipped,
        }
        write_files({out / "design.json": json_text(fields)})
        click.echo(f"wrote {out / 'design.json'}")


if __name__ == "__main__":
    main()
