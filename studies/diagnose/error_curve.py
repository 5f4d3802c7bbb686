"""The error of one place over what it depends on: the curve with its band, and the named effect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.diagnose.record import CurvePanel, ErrorCurveEntry, Row
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VECTOR = 1500  # points; a larger cloud becomes a picture within the SVG
_TWO_SIDED = 1.959964  # 95 % of a normal distribution


@style.styled
def error_curve(curve: ErrorCurveEntry) -> style.Picture:
    """A panel for each direction, one above the other or in two columns."""
    from matplotlib.ticker import MaxNLocator

    panels, levels, grid, variable = (
        curve.panels,
        curve.levels,
        _array(curve.grid),
        _array(curve.variable),
    )
    columns = 1 if len(panels) < 3 else 2
    rows = -(-len(panels) // columns)
    figure = style.sheet(
        style.PANEL if columns == 1 else 9.6, 1.0 + (3.2 if rows == 1 else 2.5) * rows
    )
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    handles: dict[str, Any] = {}
    for panel, shown in zip(axes, panels, strict=False):
        style.tidy(panel)
        panel.axhline(0.0, color=style.SOFT, linewidth=0.8, zorder=1)
        drawn = _fitted(panel, shown, grid, variable, levels)
        if shown.effect is not None:
            drawn.append(_named(panel, shown, grid, variable, curve))
        handles |= {handle.get_label(): handle for handle in drawn}
        panel.set(ylabel=shown.label, ylim=_limits(shown))
    for panel in axes[len(panels) :]:
        panel.set_visible(False)
    for panel in axes[max(0, len(panels) - columns) : len(panels)]:
        panel.set_xlabel(curve.variable_label)
        panel.tick_params(labelbottom=True)
    if levels:
        axes[0].set_xticks(grid, [f"{x:g}".replace("-", "\N{MINUS SIGN}") for x in grid])
    elif columns > 1:
        axes[0].xaxis.set_major_locator(MaxNLocator(6))
    style.legend_below(figure, list(handles.values()))
    header = ["pose", curve.variable_label]
    for shown in panels:
        own = [] if shown.effect is None else [curve.effect]
        of = ("curve", "standard deviation", "this pose alone", *own)
        header += [f"{shown.label}, {part}".replace("\n", " ") for part in of]
    return style.Picture(
        curve.name, curve.title, curve.caption, figure, tuple(header), tuple(_rows(curve))
    )


def _array(values: Row) -> Array:
    """Numbers, NaN for what is undefined."""
    return np.array(values, dtype=np.float64)


def _fitted(
    panel: Axes, shown: CurvePanel, grid: Array, variable: Array, levels: bool
) -> list[Any]:
    """What each pose says, and the curve through it with its band; entries of the legend."""
    value, half = _array(shown.value), _TWO_SIDED * _array(shown.std)
    at = style.aside(variable, 0.22 * float(np.diff(grid).min())) if levels else variable
    points, = panel.plot(
        at, _array(shown.single), color="0.6", marker="o", linestyle="", markersize=2.8,
        markeredgewidth=0.0, label="each pose by itself", zorder=2,
        rasterized=len(variable) > _VECTOR,
    )  # fmt: skip
    if levels:
        bars = panel.errorbar(
            grid, value, half, color=style.BLUE, marker="s", markersize=7.0, linestyle="",
            elinewidth=2.0, capsize=7.0, capthick=2.0, label="fitted freely, 95 % interval", zorder=3,
        )  # fmt: skip
        return [points, bars]
    band = panel.fill_between(
        grid, value - half, value + half, color=style.BLUE, alpha=0.22, linewidth=0.0,
        label="95 % band", zorder=2.5,
    )  # fmt: skip
    curve, = panel.plot(
        grid, value, color=style.BLUE, linewidth=2.0, label="fitted freely", zorder=3
    )  # fmt: skip
    return [points, curve, band]


def _named(
    panel: Axes, shown: CurvePanel, grid: Array, variable: Array, curve: ErrorCurveEntry
) -> Any:
    """The effect: a line where it is a function of the variable, else a cross for each pose."""
    values, effect = _array(shown.effect or ()), curve.effect
    look: Any = {"color": style.VERMILLION, "zorder": 4}
    if curve.levels:
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


def _limits(shown: CurvePanel) -> tuple[float, float]:
    """What the curve, its band and the effect need, and most of the points."""
    value, half = _array(shown.value), _TWO_SIDED * _array(shown.std)
    parts = [value - half, value + half, _array(shown.effect or ())]
    known = _array(shown.single)
    known = known[np.isfinite(known)]
    if len(known):
        parts.append(np.quantile(known, [0.02, 0.98]))
    every = np.concatenate(parts)
    every = every[np.isfinite(every)]
    low, high = float(every.min(initial=0.0)), float(every.max(initial=0.0))
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _rows(curve: ErrorCurveEntry) -> Iterator[tuple[style.Cell, ...]]:
    parts: list[Sequence[style.Cell]] = [curve.pose_names, curve.variable]
    for shown in curve.panels:
        parts += [shown.at_poses, shown.std_at_poses, shown.single]
        parts += [] if shown.effect is None else [shown.effect]
    yield from zip(*parts, strict=True)
