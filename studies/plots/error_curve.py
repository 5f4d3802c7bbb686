"""The error of one place over what it depends on: the curve with its band, and the named effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots.style import (
    BLUE,
    SOFT,
    VERMILLION,
    Cell,
    Picture,
    cell,
    legend_below,
    sheet,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VECTOR = 1500  # points; a larger cloud becomes a picture within the SVG
_TWO_SIDED = 1.959964  # 95 % of a normal distribution


@dataclass(frozen=True, eq=False)
class Panel:
    """One direction of the error, in the units shown.

    label : str, of the axis; value, std : ndarray, shape (g,), the curve on the grid
    at_poses, std_at_poses : ndarray, shape (m,), the curve at the poses
    single : ndarray, shape (m,), what each pose says, NaN where nothing
    effect : ndarray, shape (m,), the effect that was named, or None
    line : whether that is a line over the variable; else it is a point at each pose
    """

    label: str
    value: Array
    std: Array
    at_poses: Array
    std_at_poses: Array
    single: Array
    effect: Array | None
    line: bool


@styled
def error_curve(
    panels: Sequence[Panel],
    grid: Array,
    variable: Array,
    variable_label: str,
    pose_names: Sequence[str],
    *,
    effect: str | None,
    levels: bool = False,
    caption: str = "",
    name: str = "error_curve",
    title: str = "Located error",
) -> Picture:
    """A panel for each direction, one above the other or in two columns.

    grid : ndarray, shape (g,); variable : ndarray, shape (m,), at the poses; both as shown
    effect : name of the effect, None where there is none
    levels : whether the variable takes a few values only, between which there is nothing
    """
    from matplotlib.ticker import MaxNLocator

    columns = 1 if len(panels) < 3 else 2
    rows = -(-len(panels) // columns)
    figure = sheet(6.4 if columns == 1 else 9.6, 1.0 + (3.2 if rows == 1 else 2.5) * rows)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    handles: dict[str, Any] = {}
    for panel, shown in zip(axes, panels, strict=False):
        tidy(panel)
        panel.axhline(0.0, color=SOFT, linewidth=0.8, zorder=1)
        drawn = _fitted(panel, shown, grid, variable, levels)
        if shown.effect is not None:
            drawn.append(_named(panel, shown, shown.effect, grid, variable, effect, levels))
        handles |= {handle.get_label(): handle for handle in drawn}
        panel.set(ylabel=shown.label, ylim=_limits(shown))
    for panel in axes[len(panels) :]:
        panel.set_visible(False)
    for panel in axes[max(0, len(panels) - columns) : len(panels)]:
        panel.set_xlabel(variable_label)
        panel.tick_params(labelbottom=True)
    if levels:
        axes[0].set_xticks(grid, [f"{x:g}".replace("-", "\N{MINUS SIGN}") for x in grid])
    elif columns > 1:
        axes[0].xaxis.set_major_locator(MaxNLocator(6))
    legend_below(figure, list(handles.values()))
    header = ["pose", variable_label]
    for shown in panels:
        of = ("curve", "standard deviation", "this pose alone", *([effect] if effect else []))
        header += [f"{shown.label}, {part}".replace("\n", " ") for part in of]
    return Picture(name, title, caption, figure, tuple(header), _rows(panels, variable, pose_names))


def _fitted(panel: Axes, shown: Panel, grid: Array, variable: Array, levels: bool) -> list[Any]:
    """What each pose says, and the curve through it with its band; entries of the legend."""
    half = _TWO_SIDED * shown.std
    points, = panel.plot(
        _aside(variable, grid) if levels else variable, shown.single, color="0.6", marker="o",
        linestyle="", markersize=2.8, markeredgewidth=0.0, label="each pose by itself", zorder=2,
        rasterized=len(variable) > _VECTOR,
    )  # fmt: skip
    if levels:
        bars = panel.errorbar(
            grid, shown.value, half, color=BLUE, marker="s", markersize=7.0, linestyle="",
            elinewidth=2.0, capsize=7.0, capthick=2.0, label="fitted freely, 95 % interval", zorder=3,
        )  # fmt: skip
        return [points, bars]
    band = panel.fill_between(
        grid, shown.value - half, shown.value + half, color=BLUE, alpha=0.22, linewidth=0.0,
        label="95 % band", zorder=2.5,
    )  # fmt: skip
    curve, = panel.plot(
        grid, shown.value, color=BLUE, linewidth=2.0, label="fitted freely", zorder=3
    )  # fmt: skip
    return [points, curve, band]


def _named(
    panel: Axes,
    shown: Panel,
    values: Array,
    grid: Array,
    variable: Array,
    effect: str | None,
    levels: bool,
) -> Any:
    """The effect: a line where it is a function of the variable, else a cross for each pose."""
    look: Any = {"color": VERMILLION, "zorder": 4}
    if levels:
        at = np.argmin(np.abs(variable[:, None] - grid), axis=1)
        means = np.bincount(at, values, len(grid)) / np.maximum(np.bincount(at, None, len(grid)), 1)
        look |= {"marker": "D", "markerfacecolor": "none", "markeredgewidth": 1.8}
        look |= {"linestyle": "", "markersize": 7.0}
        handle, = panel.plot(grid, means, label=effect, **look)  # fmt: skip
    elif shown.line:
        order = np.argsort(variable, kind="stable")
        look |= {"linestyle": "--", "linewidth": 2.0}
        handle, = panel.plot(variable[order], values[order], label=effect, **look)  # fmt: skip
    else:
        look |= {"linestyle": "", "marker": "x", "markersize": 4.5}
        label = f"{effect}, at each pose"
        handle, = panel.plot(
            variable, values, label=label, rasterized=len(variable) > _VECTOR, **look
        )  # fmt: skip
    return handle


def _limits(shown: Panel) -> tuple[float, float]:
    """What the curve, its band and the effect need, and most of the points."""
    half = _TWO_SIDED * shown.std
    parts = [shown.value - half, shown.value + half]
    if shown.effect is not None:
        parts.append(shown.effect)
    known = shown.single[np.isfinite(shown.single)]
    if len(known):
        parts.append(np.quantile(known, [0.02, 0.98]))
    every = np.concatenate(parts)
    low, high = min(float(np.nanmin(every)), 0.0), max(float(np.nanmax(every)), 0.0)
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _aside(values: Array, marks: Array) -> Array:
    """Values moved apart beside their level, by a golden-ratio sequence: even and repeatable."""
    golden = (np.arange(len(values)) * 0.6180339887498949) % 1.0
    return values + 0.22 * float(np.diff(marks).min()) * (2.0 * golden - 1.0)


def _rows(
    panels: Sequence[Panel], variable: Array, names: Sequence[str]
) -> tuple[tuple[Cell, ...], ...]:
    found = []
    for i, pose in enumerate(names):
        row: list[Cell] = [pose, cell(variable[i])]
        for shown in panels:
            parts = [shown.at_poses, shown.std_at_poses, shown.single]
            parts += [] if shown.effect is None else [shown.effect]
            row += [cell(part[i]) for part in parts]
        found.append(tuple(row))
    return tuple(found)
