"""What proves a plan: how near it, and others of its size, come to the bound that no plan surpasses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from studies.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@style.styled
def certificate(result: Any) -> Figure:
    """Efficiencies of a design and of the plans beside it, proved by one bound, in per cent."""
    rows = {"this plan": result.efficiency}
    rows |= {name: rival.efficiency for name, rival in result.against.items() if rival.efficiency}
    figure, (panel,) = style.panels(style.PANEL, 1.0 + 0.4 * len(rows))
    for row, value in enumerate(rows.values()):
        panel.barh(row, 100.0 * value, 0.6, color=style.DIM if row else style.BLUE)
        panel.annotate(f"{100.0 * value:.1f} %", (100.0 * value, row), (-4, 0), ha="right", va="center",
                       textcoords="offset points", color="#ffffff")  # fmt: skip
    panel.axvline(100.0, color=style.INK, linewidth=1.2)
    panel.set_yticks(range(len(rows)), list(rows))
    panel.set(ylim=(len(rows) - 0.5, -0.5), xlim=(0.0, 104.0))
    panel.set_xlabel("proved share of the best possible plan [%]")
    panel.grid(False, axis="y")
    return figure
