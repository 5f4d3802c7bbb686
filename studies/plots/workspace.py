"""Expected accuracy over the workspace: seen from above and from the side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots.style import (
    FAINT,
    INK,
    SOFT,
    Cell,
    Picture,
    cell,
    log_ticks,
    sheet,
    short,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_VIEWS = ((0, 1), (0, 2))


@styled
def workspace(tips: Array, expected: Array) -> Picture:
    """The expected error at each target as a dot where the tip is, larger and darker for more.

    tips : ndarray, shape (n, 3), m, base frame; expected : ndarray, shape (n,), m, infinite where open
    """
    known = np.isfinite(expected) & (expected > 0.0)
    shown = expected[known] * 1e3
    figure = sheet(8.6, 4.4, "compressed")
    panels = figure.subplots(1, 2)
    for panel, (a, b) in zip(panels, _VIEWS, strict=True):
        tidy(panel)
        panel.plot(
            [0.0], [0.0], marker="+", color=INK, markersize=12, markeredgewidth=1.6, zorder=3
        )
        panel.plot(*tips[~known][:, [a, b]].T, marker="x", linestyle="", color=INK, zorder=3)
        panel.set(xlabel=f"{'xyz'[a]} of the tip [m]", ylabel=f"{'xyz'[b]} of the tip [m]")
        panel.set_aspect("equal", adjustable="datalim")
        panel.locator_params(nbins=6)
        panel.set_title(("from above", "from the side")[b - 1], loc="left")
        panel.grid(True, color=FAINT, linewidth=0.6)
    caption = (
        "The error that the uncertainty of the parameters leaves at each target pose, where the pose "
        "puts the tip; + is the robot's base. What the model lacks comes on top."
    )
    if not known.all():
        caption += " A cross marks a target whose error cannot be told: a parameter is open there."
    if known.any():
        caption += f" Smallest {short(shown.min())} mm, largest {short(shown.max())} mm."
        _coloured(figure, panels, tips[known], shown)
    header = ("", "expected [mm]", "x [m]", "y [m]", "z [m]")
    ranks = np.argsort(expected)
    rows: list[tuple[Cell, ...]] = [
        (label, cell(expected[i] * 1e3), *map(cell, tips[i]))
        for label, i in (
            ("best", ranks[0]),
            ("median", ranks[len(ranks) // 2]),
            ("worst", ranks[-1]),
        )
    ]
    title = "Expected error over the workspace"
    if known.any():
        title += f": {short(shown.min(), 2)} to {short(shown.max(), 2)} mm"
    return Picture("workspace", title, caption, figure, header, tuple(rows))


def _coloured(figure: Figure, panels: Any, tips: Array, shown: Array) -> None:
    """The dots, the largest errors on top, and the bar of their colours [mm]."""
    from matplotlib.colors import LogNorm

    low, high = float(shown.min()), float(shown.max()) * 1.0001
    order = np.argsort(shown)
    look: Any = {
        "cmap": "viridis_r",
        "norm": LogNorm(low, max(high, 1.05 * low)),
        "edgecolors": SOFT,
        "linewidths": 0.4,
    }
    size = 14.0 + 60.0 * (shown[order] / high) ** 2
    for panel, (a, b) in zip(panels, _VIEWS, strict=True):
        at = tips[order]
        dots = panel.scatter(at[:, a], at[:, b], size, shown[order], zorder=2, **look)
    bar = figure.colorbar(dots, ax=panels, shrink=0.8, aspect=30)
    log_ticks(bar.ax.yaxis, low, high)
    bar.set_label("expected error [mm], RMS in space")
    bar.outline.set_visible(False)
