"""What a diagnosis found: what each cause takes off the error, and the error of a place as a curve."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.arrays import Array
from studies.figures import style
from studies.results.curves import CurvePanel, ErrorCurve
from studies.results.diagnose import DiagnoseResult

_TEXT = 0.18  # width of a number, over the longest bar
_TWO_SIDED = 1.959964  # 95 % of a normal distribution


@style.styled
def causes(result: DiagnoseResult) -> Figure | None:
    """RMS before, what each cause takes off it when it is added to those above, and what is left."""
    steps = result.steps
    if steps is None:
        return None
    values, n = np.array(steps.rms_mm), len(steps.added)
    starts, ends = [0.0, *values[:-1]], [values[0], *values[1:]]
    labels = ["before", *map(style.elided, steps.added)]
    if n:
        starts, ends, labels = [*starts, 0.0], [*ends, values[-1]], [*labels, "after"]
    colors = [
        style.DIM,
        *np.where(np.diff(values) > 0.0, style.VERMILLION, style.BLUE),
        *([style.SOFT] if n else []),
    ]
    figure, (panel,) = style.panels(style.PANEL, 1.3 + 0.42 * len(labels))
    most = max(float(values.max()), result.gap.floor_mm)
    for row, (start, end, color) in enumerate(zip(starts, ends, colors, strict=True)):
        panel.barh(row, abs(end - start), 0.62, left=min(start, end), color=color)
        change = f"{end - start:+.3g}".replace("-", "\N{MINUS SIGN}")
        text = change if 0 < row <= n else f"{end:.3g}"
        panel.annotate(
            text, (max(start, end), row), (5, 0), textcoords="offset points", va="center"
        )
    floor = f"noise alone, {result.gap.floor_mm:.3g} {steps.unit}"
    panel.axvline(
        result.gap.floor_mm, color=style.INK, linewidth=1.3, linestyle=style.DASHED, label=floor
    )
    panel.set_yticks(range(len(labels)), labels)
    panel.set(xlim=(0.0, (1.0 + _TEXT) * most), ylim=(len(labels) - 0.4, -0.6))
    panel.set_xlabel(f"RMS error at {steps.of} [{steps.unit}]")
    panel.grid(False, axis="y")
    style.legend(figure)
    return figure


@style.styled
def located_curve(result: DiagnoseResult, curve: ErrorCurve) -> Figure:  # noqa: ARG001
    """The error of a place over what it depends on, a panel a direction, with its 95 % band."""
    across = 1 if len(curve.panels) < 3 else 2
    down = -(-len(curve.panels) // across)
    figure, every = style.panels(
        style.PANEL if across == 1 else 9.6, 1.0 + (3.0 if down == 1 else 2.4) * down, down, across,
        sharex=True
    )  # fmt: skip
    for panel, shown in zip(every, curve.panels, strict=False):
        panel.axhline(0.0, color=style.SOFT, linewidth=0.8)
        _fitted(panel, curve, shown)
        if shown.effect is not None:
            _named(panel, curve, shown, _array(shown.effect))
        panel.set(ylabel=shown.label, ylim=_limits(shown))
    for panel in every[len(curve.panels) :]:
        panel.remove()
    for panel in every[: len(curve.panels)][-across:]:
        panel.set_xlabel(curve.variable_label)
        panel.tick_params(labelbottom=True)
    if curve.levels:
        every[0].set_xticks(curve.grid, [f"{x:g}" for x in curve.grid])
    style.legend(figure)
    return figure


def _fitted(panel: Axes, curve: ErrorCurve, shown: CurvePanel) -> None:
    """What each pose says, and the curve through it with its band."""
    grid, value, half = _array(curve.grid), _array(shown.value), _TWO_SIDED * _array(shown.std)
    x = _array(curve.variable)
    if curve.levels:  # apart, by a golden-ratio sequence: even and repeatable
        golden = (np.arange(len(x)) * 0.6180339887498949) % 1.0
        x = x + 0.22 * float(np.diff(grid).min()) * (2.0 * golden - 1.0)
    single = style.Look("each pose by itself", style.DIM, "o")
    style.dots(panel, x, _array(shown.single), single, markersize=2.8, markeredgewidth=0.0)
    if curve.levels:
        panel.errorbar(
            grid, value, half, color=style.BLUE, marker="s", markersize=7.0, linestyle="", capsize=7.0,
            label="fitted freely, 95 % interval"
        )  # fmt: skip
        return
    panel.fill_between(
        grid, value - half, value + half, color=style.BLUE, alpha=0.22, linewidth=0.0
    )
    panel.plot(grid, value, color=style.BLUE, linewidth=2.0, label="fitted freely, 95 % band")


def _named(panel: Axes, curve: ErrorCurve, shown: CurvePanel, effect: Array) -> None:
    """The cause: a line where it is a function of the variable, else a cross for each pose."""
    x, look = (
        _array(curve.variable),
        style.Look(str(curve.effect), style.VERMILLION, "D" if curve.levels else "x"),
    )
    if curve.levels:
        grid = _array(curve.grid)
        at = np.argmin(np.abs(x[:, None] - grid), axis=1)
        means = np.bincount(at, effect, len(grid)) / np.maximum(np.bincount(at, None, len(grid)), 1)
        style.dots(panel, grid, means, look, markerfacecolor="none", markersize=7.0)
    elif shown.line:
        order = np.argsort(x, kind="stable")
        panel.plot(
            x[order], effect[order], color=style.VERMILLION, linestyle="--", label=look.label
        )
    else:
        style.dots(panel, x, effect, look)


def _limits(shown: CurvePanel) -> tuple[float, float]:
    """What the curve, its band and the cause need, and most of the points."""
    value, half, known = _array(shown.value), _TWO_SIDED * _array(shown.std), _array(shown.single)
    known = known[np.isfinite(known)]
    parts: list[Any] = [value - half, value + half, _array(shown.effect or ())]
    parts += [np.quantile(known, [0.02, 0.98])] if len(known) else []
    every = np.concatenate(parts)
    every = every[np.isfinite(every)]
    low, high = float(every.min(initial=0.0)), float(every.max(initial=0.0))
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _array(values: Any) -> Array:
    """Numbers, NaN for what is undefined."""
    return np.array(values, dtype=np.float64)
