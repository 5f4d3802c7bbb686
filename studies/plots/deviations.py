"""Standard deviations of the parameters by approach."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ONE_COLUMN = 20  # more parameters stand in two columns, without numbers at the margin
_HEAD = 3.0  # height of a panel's axis, in rows
_NUMBER_PT = 50.0  # width of a number at the margin


@style.styled
def by_approach(
    names: Sequence[str],
    units: Sequence[str],
    std: Mapping[str, Array],
    *,
    name: str = "deviations",
    title: str = "Uncertainty of each parameter, by approach",
) -> style.Picture:
    """Standard deviations on log axes, one panel a unit, the numbers at the margin.

    names, units : of the p parameters
    std : approach -> ndarray, shape (p,), in these units; NaN or infinite where not estimable
    """
    look = style.looks(std)
    figure, panels = _panels(names, units)
    margin = len(names) <= _ONE_COLUMN
    absent = False
    for first, (panel, rows) in zip([True, *[False] * len(panels)], panels, strict=False):
        values = {key: _positive(array)[rows] for key, array in std.items()}
        absent |= _any_missing(values)
        _log_limits(panel, values)
        _spans(panel, values)
        _dots(panel, values, look)
        if margin:
            _numbers(panel, values, look, head=first)
        panel.set_xlabel(f"standard deviation [{units[rows[0]]}]")
    handles = [style.key_of(look[key], linestyle="") for key in std]
    if absent:
        missing = style.Look("cannot be estimated", style.SOFT, "x")
        handles.append(style.key_of(missing))
    style.legend_below(figure, handles)
    caption = (
        "Standard deviation of each parameter on a log scale; a row is a parameter, further left is "
        "better."
    )
    if absent:
        caption += " A cross at the right edge: this approach cannot estimate the parameter."
    header, table = _table(names, units, std)
    return style.Picture(name, title, caption, figure, header, table)


# -- rows of parameters ------------------------------------------------------------------------


def _panels(
    names: Sequence[str], groups: Sequence[str]
) -> tuple[Figure, list[tuple[Axes, list[int]]]]:
    """A panel for each group, parameters as rows from above; two columns where they are many."""
    labels = style.brief(names)
    members = [[i for i, g in enumerate(groups) if g == group] for group in dict.fromkeys(groups)]
    columns = [members]
    if len(names) > _ONE_COLUMN:
        columns = _halves(members)
    tallest = max(_height(column) for column in columns)
    figure = style.sheet(7.2 if len(columns) == 1 else 9.6, 0.75 + 0.195 * tallest)
    made: list[tuple[Axes, list[int]]] = []
    halves = figure.subfigures(1, len(columns), squeeze=False)[0]
    for half, column in zip(halves, columns, strict=True):
        heights = [len(rows) + 0.6 for rows in column]
        rest = tallest - _height(column)
        grid = half.add_gridspec(
            len(heights) + (rest > 1.0), 1, height_ratios=heights + [rest] * (rest > 1.0)
        )
        for place, rows in enumerate(column):
            panel = half.add_subplot(grid[place, 0])
            style.tidy(panel, "x")
            panel.set_yticks(range(len(rows)), [labels[i] for i in rows], fontsize=9)
            panel.set_ylim(len(rows) - 0.45, -0.55)
            for row in range(1, len(rows), 2):
                panel.axhspan(row - 0.5, row + 0.5, color="0.965", linewidth=0, zorder=0)
            panel.tick_params(axis="y", length=0)
            panel.tick_params(axis="x", labelsize=9)
            made.append((panel, rows))
    return figure, made


def _height(column: list[list[int]]) -> float:
    return sum(len(rows) + _HEAD for rows in column)


def _halves(members: list[list[int]]) -> list[list[list[int]]]:
    """Panels on two columns of about equal height; a single one is cut in the middle."""
    if len(members) == 1:
        middle = (len(members[0]) + 1) // 2
        return [[members[0][:middle]], [members[0][middle:]]]
    cuts = range(1, len(members))
    cut = min(cuts, key=lambda c: max(_height(members[:c]), _height(members[c:])))
    return [members[:cut], members[cut:]]


def _positive(values: Array) -> Array:
    """Values with NaN for what is not a standard deviation."""
    values = np.asarray(values, dtype=float)
    out: Array = np.where(np.isfinite(values) & (values > 0.0), values, np.nan)
    return out


def _log_limits(panel: Axes, values: Mapping[str, Array]) -> None:
    known = np.concatenate([v[np.isfinite(v)] for v in values.values()])
    low, high = (known.min(), known.max()) if len(known) else (1.0, 1.0)
    low, high = low / 1.25, high * 1.25
    if high / low < 5.0:  # enough for two labels at least
        low, high = low / math.sqrt(5.0 * low / high), high * math.sqrt(5.0 * low / high)
    panel.set(xscale="log", xlim=(low, high * (high / low) ** (0.08 * _any_missing(values))))
    style.log_ticks(panel.xaxis, low, high)


def _any_missing(values: Mapping[str, Array]) -> bool:
    return any(bool(np.isnan(v).any()) for v in values.values())


def _spans(panel: Axes, values: Mapping[str, Array]) -> None:
    """A thin line from the best to the worst approach of each parameter."""
    stack = np.array(list(values.values()))
    for row, of_row in enumerate(stack.T):
        if np.isfinite(of_row).any():
            ends = [np.nanmin(of_row), np.nanmax(of_row)]
            panel.plot(ends, [row, row], color="0.7", linewidth=1.0, zorder=1)


def _dots(panel: Axes, values: Mapping[str, Array], look: Mapping[str, style.Look]) -> None:
    """Marks by approach, a little apart so that equal ones stay visible; crosses where absent."""
    count = len(values)
    for place, (key, array) in enumerate(values.items()):
        rows = np.arange(len(array)) + 0.22 * (place - (count - 1) / 2.0)
        mark: dict[str, Any] = {"color": look[key].color, "linestyle": ""}
        panel.plot(array, rows, marker=look[key].marker, markersize=4.5, **mark)
        missing = rows[np.isnan(array)]
        mark |= {"marker": "x", "markersize": 4.0, "transform": panel.get_yaxis_transform()}
        panel.plot(np.full(len(missing), 0.985), missing, **mark)


def _numbers(
    panel: Axes, values: Mapping[str, Array], look: Mapping[str, style.Look], head: bool
) -> None:
    """The values in columns right of the panel, headed by the sign of the approach."""
    place: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
    place |= {"ha": "right", "va": "center"}
    for column, (key, array) in enumerate(values.items()):
        shift = 8.0 + _NUMBER_PT * (column + 1)
        for row, value in enumerate(array):
            text = style.short(value) or "absent"
            panel.annotate(text, (1.0, row), (shift, 0.0), fontsize=9, color=style.INK, **place)
        if head:
            sign: Any = {"color": look[key].color, "annotation_clip": False}
            panel.annotate(look[key].sign, (1.0, -0.85), (shift, 0.0), **sign, **place)


# -- tables ------------------------------------------------------------------------------------


def _table(
    names: Sequence[str], units: Sequence[str], std: Mapping[str, Array]
) -> tuple[tuple[str, ...], tuple[tuple[style.Cell, ...], ...]]:
    look = style.looks(std)
    header = ["parameter", "unit", *(look[key].label for key in std)]
    columns = [_positive(array) for array in std.values()]
    if "points" in std:
        rivals = [key for key in std if key != "points"]
        header += [f"{look[key].label} / {look['points'].label}" for key in rivals]
        columns += [_positive(std[key]) / _positive(std["points"]) for key in rivals]
    return tuple(header), _rows(names, units, columns)


def _rows(
    names: Sequence[str], units: Sequence[str], columns: Sequence[Array]
) -> tuple[tuple[style.Cell, ...], ...]:
    return tuple(
        (label, unit, *(style.cell(column[i]) for column in columns))
        for i, (label, unit) in enumerate(zip(names, units, strict=True))
    )
