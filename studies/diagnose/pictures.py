"""The figures of a diagnosis: how the error falls, and its curve at each place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.diagnose.record import (
    CurvePanel,
    ErrorCurveEntry,
    ErrorSteps,
    Row,
)
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MOST_DIGITS = 9
_HEIGHT = 0.62
_BARE: Any = {"edgecolor": "white", "linewidth": 0.0}
_TEXT = 0.16  # width of a number, over the longest bar


@style.styled
def waterfall(steps: ErrorSteps, floor_mm: float) -> style.Picture:
    """RMS before, what each effect takes off it when it is added to those above, and what is left.

    floor_mm : RMS of the noise alone, above zero
    """
    values, names, low = np.array(steps.rms_mm), steps.added, floor_mm
    n, of = len(names), steps.of
    labels = ["before: model as given", *names, *(["after: what is left"] if n else [])]
    figure = style.sheet(style.PANEL, 1.5 + 0.44 * len(labels))
    panel = figure.subplots()
    style.tidy(panel, "x")
    most = max(float(values.max()), low)
    digits = min(max(0, 2 - int(np.floor(np.log10(most)))), _MOST_DIGITS)
    for at, (end, text) in enumerate([*_bars(panel, values, digits)]):
        beside = low if end <= low < end + _TEXT * most else end
        place: Any = {"textcoords": "offset points", "va": "center", "ha": "left"}
        panel.annotate(text, (beside, at), (5.0, -0.5), color=style.INK, **place)
    floor = f"floor: noise alone, {style.short(low)} {steps.unit}"
    line = panel.axvline(low, color=style.INK, linewidth=1.4, linestyle=style.DASHED, label=floor)
    panel.set_yticks(range(len(labels)), labels)
    panel.tick_params(axis="y", length=0)
    panel.set(xlim=(0.0, (1.0 + _TEXT) * most), ylim=(len(labels) - 0.4, -0.6))
    panel.set_xlabel(f"RMS error at {of} [{steps.unit}]")
    style.legend_below(figure, [line, *_key(values)])
    caption = f"3-D root mean square error of the {of}. " + (
        "Each effect is added to those above it and the whole model fitted again, so that a bar is "
        "what the effect still takes off; where effects overlap the order matters. "
        if n
        else "No effect was found that would take anything off. "
    )
    caption += (
        f"What is left is {values[-1] / low:.2f} times the floor, which noise alone would leave."
    )
    header = ("step", *(f"{what} [{steps.unit}]" for what in ("RMS", "change", "floor")))
    title = f"The error before, {style.short(values[0])} {steps.unit}, and what no cause explains"
    if n:
        was, now = (style.short(float(value), 2) for value in (values[0], values[-1]))
        title = f"What each cause takes off: from {was} to {now} {steps.unit}"
    rows = tuple(_rows(labels, values, low))
    return style.Picture("waterfall", title, caption, figure, header, rows)


def _rows(labels: Sequence[str], values: Array, floor: float) -> Iterator[tuple[style.Cell, ...]]:
    """The error at each step and its change; at the end what is left."""
    changes: list[float | None] = [None, *np.diff(values).tolist()]
    for label, value, change in zip(labels, values.tolist(), changes, strict=False):
        yield label, value, change, floor
    if len(values) > 1:
        yield labels[-1], float(values[-1]), None, floor


def _bars(panel: Axes, values: Array, digits: int) -> Iterator[tuple[float, str]]:
    """Draw the error before, its changes and what is left; yields each bar's end and number."""
    n = len(values) - 1
    _bar(panel, 0, 0.0, values[0], {"color": "0.72"})
    yield values[0], f"{values[0]:.{digits}f}"
    for i in range(n):
        start, end = values[i], values[i + 1]
        worse = end > start
        look: Any = {
            "color": style.VERMILLION if worse else style.BLUE,
            "hatch": "//" if worse else "",
        }
        _bar(panel, i + 1, start, end, look)
        _step(panel, i, start)
        sign = "+" if worse else "\N{MINUS SIGN}"
        yield max(start, end), f"{sign}{abs(end - start):.{digits}f}"
    if n:
        _step(panel, n, values[n])
        _bar(panel, n + 1, 0.0, values[n], {"color": "0.45"})
        yield values[n], f"{values[n]:.{digits}f}"


def _bar(panel: Axes, at: int, start: float, end: float, look: Any) -> None:
    panel.barh(at, abs(end - start), _HEIGHT, left=min(start, end), **_BARE, **look)


def _step(panel: Axes, above: int, at: float) -> None:
    """The line that leads from one bar to the next."""
    ends = [above - _HEIGHT / 2, above + 1 + _HEIGHT / 2]
    panel.plot([at, at], ends, color=style.SOFT, linewidth=0.8)


def _key(values: Array) -> list[Any]:
    """Entries for what the bars mean, those that occur."""
    change = np.diff(values)
    found = []
    if (change <= 0.0).any():
        found.append(style.patch_key("taken off by an effect", facecolor=style.BLUE))
    if (change > 0.0).any():
        worse: Any = {"facecolor": style.VERMILLION, "hatch": "//", **_BARE}
        found.append(style.patch_key("added by an effect", **worse))
    return found


_VECTOR = 1500  # points; a larger cloud becomes a picture within the SVG
_TWO_SIDED = 1.959964  # 95 % of a normal distribution


@style.styled
def error_curve(curve: ErrorCurveEntry) -> style.Picture:
    """A panel for each direction, one above the other or in two columns."""
    from matplotlib.ticker import MaxNLocator

    panels, levels = curve.panels, curve.levels
    grid, variable = _array(curve.grid), _array(curve.variable)
    columns = 1 if len(panels) < 3 else 2

    def size(across: int, down: int) -> tuple[float, float]:
        return style.PANEL if across == 1 else 9.6, 1.0 + (3.2 if down == 1 else 2.5) * down

    figure, axes = style.small_panels(len(panels), columns, size, sharex=True)
    handles: dict[str, Any] = {}
    for panel, shown in zip(axes, panels, strict=True):
        style.tidy(panel)
        panel.axhline(0.0, color=style.SOFT, linewidth=0.8, zorder=1)
        drawn = _fitted(panel, shown, grid, variable, levels)
        if shown.effect is not None:
            drawn.append(_named(panel, shown, grid, variable, curve))
        handles |= {handle.get_label(): handle for handle in drawn}
        panel.set(ylabel=shown.label, ylim=_limits(shown))
    for panel in axes[-columns:]:
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
    rows = tuple(_curve_rows(curve))
    return style.Picture(curve.name, curve.title, curve.caption, figure, tuple(header), rows)


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


def _curve_rows(curve: ErrorCurveEntry) -> Iterator[tuple[style.Cell, ...]]:
    parts: list[Sequence[style.Cell]] = [curve.pose_names, curve.variable]
    for shown in curve.panels:
        parts += [shown.at_poses, shown.std_at_poses, shown.single]
        parts += [] if shown.effect is None else [shown.effect]
    yield from zip(*parts, strict=True)
