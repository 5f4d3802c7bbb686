"""Expected accuracy: by the number of poses, and over the workspace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_GUIDE = "1/sqrt(n), repetition"


@style.styled
def against_number(
    counts: Sequence[int],
    accuracy: Mapping[str, Array],
) -> style.Picture:
    """Accuracy over the number of poses, a line for each plan.

    counts : numbers of them, shape (k,)
    accuracy : plan -> ndarray, shape (k,), m; NaN where not estimable
    """
    look = style.looks(accuracy)
    n = np.asarray(counts, dtype=float)
    scale, unit = length_unit(accuracy)
    lines = {key: np.asarray(values, dtype=float) * scale for key, values in accuracy.items()}
    sizes = iter(np.linspace(5.0 + 1.5 * (len(lines) - 1), 5.0, len(lines)))
    figure = style.sheet(style.PANEL, 3.9)
    panel = figure.subplots()
    style.tidy(panel)
    for key, values in lines.items():
        size = next(sizes)  # marks that coincide stand within each other
        panel.plot(n, values, **look[key].line, markersize=size, label=look[key].label)
    label = f"task RMS [{unit}]"
    panel.set(xscale="log", yscale="log", xlabel="number of poses n", ylabel=label)
    guide = _guide(panel, n, lines)
    known = np.concatenate([v[np.isfinite(v)] for v in lines.values()])
    if len(known):
        style.log_ticks(panel.yaxis, known.min(), known.max())
        panel.set_ylim(0.85 * panel.dataLim.y0, 1.12 * panel.dataLim.y1)
    else:  # nothing could be estimated: an empty panel, as the table says
        panel.set_ylim(1.0, 10.0)
    _count_ticks(panel, counts)
    handles = [*(style.key_of(look[key]) for key in accuracy), *guide]
    style.legend_below(figure, handles)
    caption = (
        "Task RMS over the number of poses, both on log scales; lower is better. "
        "The grey line falls as 1/sqrt(n), the gain of mere repetition."
    )
    header = ("poses", *(f"{look[key].label} [{unit}]" for key in accuracy))
    rows = tuple(
        (float(count), *(style.cell(values[i]) for values in lines.values()))
        for i, count in enumerate(counts)
    )
    title = "Expected error by the number of poses"
    return style.Picture("accuracy_poses", title, caption, figure, header, rows)


def length_unit(values: Mapping[str, Array]) -> tuple[float, str]:
    """Factor from metres, and unit: micrometres below half a millimetre, millimetres above."""
    known = [np.asarray(v)[np.isfinite(v)] for v in values.values()]
    largest = max((float(v.max()) for v in known if len(v)), default=0.0)
    return (1e6, "um") if largest < 5e-4 else (1e3, "mm")


def _guide(panel: Axes, n: Array, lines: Mapping[str, Array]) -> list[Any]:
    """1/sqrt(n) below the lowest line, so that it crosses none of them; its entry in the legend."""
    scaled = np.array(list(lines.values())) * np.sqrt(n)
    if not np.isfinite(scaled).any():
        return []
    guide = 0.8 * np.nanmin(scaled) / np.sqrt(n)
    return panel.plot(n, guide, color=style.SOFT, linewidth=1.0, zorder=1, label=_GUIDE)


def _count_ticks(panel: Axes, counts: Sequence[int]) -> None:
    """Ticks at the counts themselves, left out where their labels would meet."""
    from matplotlib.ticker import NullLocator

    kept: list[int] = []
    span = np.log(max(counts) / min(counts)) or 1.0
    for count in sorted(set(counts)):
        if not kept or np.log(count / kept[-1]) > 0.055 * span:
            kept.append(count)
    panel.set_xticks(kept, [str(count) for count in kept])
    panel.xaxis.set_minor_locator(NullLocator())


_VIEWS = ((0, 1), (0, 2))


@style.styled
def workspace(tips: Array, expected: Array) -> style.Picture:
    """The expected error at each target as a dot where the tip is, larger and darker for more.

    tips : ndarray, shape (n, 3), m, base frame; expected : ndarray, shape (n,), m, infinite where open
    """
    known = np.isfinite(expected) & (expected > 0.0)
    shown = expected[known] * 1e3
    figure = style.sheet(8.6, 4.4, "compressed")
    panels = figure.subplots(1, 2)
    for panel, (a, b) in zip(panels, _VIEWS, strict=True):
        style.tidy(panel)
        panel.plot(
            [0.0], [0.0], marker="+", color=style.INK, markersize=12, markeredgewidth=1.6, zorder=3
        )
        panel.plot(*tips[~known][:, [a, b]].T, marker="x", linestyle="", color=style.INK, zorder=3)
        panel.set(xlabel=f"{'xyz'[a]} of the tip [m]", ylabel=f"{'xyz'[b]} of the tip [m]")
        panel.set_aspect("equal", adjustable="datalim")
        panel.locator_params(nbins=6)
        panel.set_title(("from above", "from the side")[b - 1], loc="left")
        panel.grid(True, color=style.FAINT, linewidth=0.6)
    caption = (
        "The error that the uncertainty of the parameters leaves at each target pose, where the pose "
        "puts the tip; + is the robot's base. What the model lacks comes on top."
    )
    if not known.all():
        caption += " A cross marks a target whose error cannot be told: a parameter is open there."
    title = "Expected error over the workspace"
    if known.any():
        least, most = shown.min(), shown.max()
        caption += f" Smallest {style.short(least)} mm, largest {style.short(most)} mm."
        title += f": {style.short(least, 2)} to {style.short(most, 2)} mm"
        _coloured(figure, panels, tips[known], shown)
    header = ("", "expected [mm]", "x [m]", "y [m]", "z [m]")
    ranks = np.argsort(expected)
    shares = {"best": 0, "median": len(ranks) // 2, "worst": -1}
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (label, *map(style.cell, (expected[ranks[k]] * 1e3, *tips[ranks[k]])))
        for label, k in shares.items()
    )
    return style.Picture("workspace", title, caption, figure, header, rows)


def _coloured(figure: Figure, panels: Any, tips: Array, shown: Array) -> None:
    """The dots, the largest errors on top, and the bar of their colours [mm]."""
    from matplotlib.colors import LogNorm

    low, high = float(shown.min()), float(shown.max()) * 1.0001
    order = np.argsort(shown)
    look: Any = {
        "cmap": "viridis_r",
        "norm": LogNorm(low, max(high, 1.05 * low)),
        "edgecolors": style.SOFT,
        "linewidths": 0.4,
    }
    size = 14.0 + 60.0 * (shown[order] / high) ** 2
    for panel, (a, b) in zip(panels, _VIEWS, strict=True):
        at = tips[order]
        dots = panel.scatter(at[:, a], at[:, b], size, shown[order], zorder=2, **look)
    bar = figure.colorbar(dots, ax=panels, shrink=0.8, aspect=30)
    style.log_ticks(bar.ax.yaxis, low, high)
    bar.set_label("expected error [mm], RMS in space")
    bar.outline.set_visible(False)
