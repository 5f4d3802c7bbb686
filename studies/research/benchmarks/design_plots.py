"""Pictures of ``benchmarks.design``: cost against candidates and against parameters."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.plots.style import DPI, SERIES, styled, tidy
from studies.research.benchmarks.design_runs import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLES = [look.line for look in SERIES[:4]]


@styled
def cost_by_candidates(pools: list[Row], solved: list[Row], case: str) -> Figure:
    """Seconds of pool, relaxation and exchange, one panel a criterion."""
    criteria = list(dict.fromkeys(row["criterion"] for row in solved))
    figure, panels = _panels(len(criteria))
    for panel, criterion in zip(panels, criteria, strict=True):
        rows = [r for r in solved if r["case"] == case and r["criterion"] == criterion]
        own = [r for r in pools if r["case"] == case]
        lines = [("pool with blocks", own, "pool [s]")]
        lines += [(name, rows, f"{name} [s]") for name in ("relaxation", "exchange")]
        for style, (label, data, key) in zip(STYLES, lines, strict=False):
            panel.plot(
                [r["candidates"] for r in data], [r[key] for r in data], label=label, **style
            )
        panel.set(title=f"criterion {criterion}", xlabel="candidates", xscale="log", yscale="log")
    panels[0].set_ylabel("time [s]")
    _legend(figure, panels[0])
    return figure


@styled
def cost_by_parameters(rows: list[Row], limit: float) -> Figure:
    """Seconds of the relaxation by master, one panel a criterion; stopped runs point upwards."""
    criteria = list(dict.fromkeys(row["criterion"] for row in rows))
    sizes = sorted({row["candidates"] for row in rows if row["p"] and row["p"] > 9})
    figure, panels = _panels(len(criteria))
    for panel, criterion in zip(panels, criteria, strict=True):
        lines = [(master, n) for master in ("conic", "interior point") for n in sizes]
        for style, (master, n) in zip(STYLES, lines, strict=False):
            own = [
                r
                for r in rows
                if (r["criterion"], r["master"], r["candidates"]) == (criterion, master, n)
            ]
            done = [r for r in own if r["seconds"] is not None]
            label = f"{master}, {n:,} candidates".replace(",", " ").replace("  ", ", ")
            panel.plot([r["p"] for r in done], [r["seconds"] for r in done], label=label, **style)
            over = [r["p"] for r in own if r["seconds"] is None]
            arrow: Any = {"ls": "", "marker": r"$\uparrow$", "ms": 10}
            panel.plot(over, [limit] * len(over), color=style["color"], **arrow)
        if any(row["seconds"] is None for row in rows):
            panel.plot([], [], color="0.3", label=f"stopped after {limit:g} s", **arrow)
        ticks = sorted({row["p"] for row in rows})
        panel.set(title=f"criterion {criterion}", xlabel="parameters p", yscale="log")
        panel.set_xticks(ticks)
    panels[0].set_ylabel("relaxation to a certified 1e-4 [s]")
    _legend(figure, panels[0])
    return figure


@styled
def save(figure: Figure, path: Path) -> Iterable[Path]:
    """The figure as PNG and SVG; path without suffix."""
    written = [path.with_suffix(suffix) for suffix in (".png", ".svg")]
    for target in written:
        figure.savefig(target, dpi=DPI)
    return written


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1.0 + 3.0 * count, 3.9), layout="constrained")
    panels = list(figure.subplots(1, count, sharey=True, squeeze=False)[0])
    for panel in panels:
        tidy(panel)
    return figure, panels


def _legend(figure: Figure, panel: Axes) -> None:
    handles, labels = panel.get_legend_handles_labels()
    columns = 3 if len(labels) == 3 else 2
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )
