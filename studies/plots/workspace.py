"""Expected accuracy over the workspace: seen from above and from the side."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.se3 import Array
from studies.plots.style import (
    FAINT,
    INK,
    Cell,
    Picture,
    cell,
    log_ticks,
    sheet,
    short,
    styled,
    tidy,
)

_VIEWS = ((0, 1), (0, 2))


@styled
def workspace(
    tips: Array,
    expected: Array,
    *,
    name: str = "workspace",
    title: str = "Expected error over the workspace",
) -> Picture:
    """The expected error at each target as a dot where the tip is, larger and darker for more.

    tips : ndarray, shape (n, 3), m, base frame; expected : ndarray, shape (n,), m, infinite where open
    """
    from matplotlib.colors import LogNorm

    known = np.isfinite(expected)
    shown = expected[known] * 1e3
    figure = sheet(8.6, 4.4, "compressed")
    panels = figure.subplots(1, 2)
    if not len(shown) or shown.max() <= 0.0:
        shown, known = np.ones(len(tips)), np.ones(len(tips), dtype=bool)
    low, high = float(shown.min()), float(shown.max()) * 1.0001
    norm = LogNorm(low, max(high, 1.05 * low))
    order = np.argsort(shown)
    size = 14.0 + 60.0 * (shown[order] / high) ** 2
    for panel, (a, b) in zip(panels, _VIEWS, strict=True):
        tidy(panel)
        look: Any = {"cmap": "viridis_r", "norm": norm, "edgecolors": "white", "linewidths": 0.4}
        at = tips[known][order]
        dots = panel.scatter(at[:, a], at[:, b], size, shown[order], zorder=2, **look)
        panel.plot(
            [0.0], [0.0], marker="+", color=INK, markersize=12, markeredgewidth=1.6, zorder=3
        )
        panel.plot(*tips[~known][:, [a, b]].T, marker="x", linestyle="", color=INK, zorder=3)
        panel.set(xlabel=f"{'xyz'[a]} of the tip [m]", ylabel=f"{'xyz'[b]} of the tip [m]")
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_title(("from above", "from the side")[b - 1], loc="left")
        panel.grid(True, color=FAINT, linewidth=0.6)
    bar = figure.colorbar(dots, ax=panels, shrink=0.8, aspect=30)
    log_ticks(bar.ax.yaxis, low, high)
    bar.set_label("expected error [mm], RMS in space")
    bar.outline.set_visible(False)
    worst = int(np.argmax(np.where(np.isfinite(expected), expected, np.inf)))
    caption = (
        "The error that the uncertainty of the parameters leaves at each target pose, where the pose "
        f"puts the tip; + is the robot's base. Smallest {short(low)} mm, largest {short(high)} mm. "
        "What the model lacks comes on top."
    )
    header = ("", "expected [mm]", "x [m]", "y [m]", "z [m]")
    ranks = np.argsort(expected)
    rows: list[tuple[Cell, ...]] = [
        (label, cell(expected[i] * 1e3), *map(cell, tips[i]))
        for label, i in (("best", ranks[0]), ("median", ranks[len(ranks) // 2]), ("worst", worst))
    ]
    return Picture(name, title, caption, figure, header, tuple(rows))
