"""How well parameters are known: their deviations beside their sizes, by approach, in pairs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.figure import Figure

from calib.arrays import Array
from studies.figures import style
from studies.results.identify import IdentifyResult
from studies.results.parts import ParameterStd

_Series: TypeAlias = Mapping[style.Look, Sequence[float | None]]
_ONE_COLUMN = 45  # more parameters stand in two columns
_ACROSS = 3  # style.panels of pairs
_RADIUS = math.sqrt(-2.0 * math.log(0.05))  # of the 95 % ellipse of two normal variables
_SIZE = style.Look("size of the value", style.BLUE, "o")
_STD = style.Look("standard deviation", style.VERMILLION, "^")
_PREDICTED = style.Look("predicted standard deviation", style.BLUE, "o")
_LOOKS = {
    "pose plain": style.Look("#1 pose, plain", style.VERMILLION, "o", ":"),
    "pose normalised": style.Look("#1 pose, normalised", style.PURPLE, "s", "-."),
    "pose full": style.Look("#1 pose, full covariance", style.GREEN, "^", "--"),
    "points": style.Look("#2 points", style.BLUE, "D", "-"),
}
_OTHERS = ((style.BLUE, "D"), (style.VERMILLION, "o"), (style.GREEN, "^"), (style.PURPLE, "s"))


@style.styled
def deviations(result: IdentifyResult) -> Figure | None:
    """Size and standard deviation of the robot's parameters; None where there is none."""
    robot = [p for p in result.parameters if not p.placed]
    return _by_unit(robot, {_SIZE: [abs(p.value) for p in robot], _STD: [p.std for p in robot]})


@style.styled
def predicted_deviations(result: Any) -> Figure | None:
    """Standard deviations that a design predicts."""
    predicted = result.predicted_std
    return _by_unit(predicted, {_PREDICTED: [p.std for p in predicted]})


@style.styled
def deviations_by_approach(result: Any) -> Figure | None:
    """Standard deviations of a comparison: by approach of one plan, or by plan of several (#2)."""
    first = result.plans[0]
    if len(result.plans) == 1:
        every = {_LOOKS[approach.key]: approach for approach in first.approaches}
    else:
        shared = [plan for plan in result.plans if plan.ids == first.ids]
        every = {
            style.Look(plan.plan, *_OTHERS[k % len(_OTHERS)]): plan.points
            for k, plan in enumerate(shared)
        }
    series = {look: [p.std for p in approach.parameters] for look, approach in every.items()}
    return _by_unit(first.points.parameters, series)


def _by_unit(parameters: Sequence[ParameterStd], series: _Series) -> Figure | None:
    """Positive values on log axes, a panel a unit, a row a parameter; two columns of many.

    None without a parameter
    """
    if not parameters:
        return None
    names, units = [p.id for p in parameters], [p.unit for p in parameters]
    values = {look: _positive(column) for look, column in series.items()}
    blocks = list(_blocks(units, 2 if len(names) > _ONE_COLUMN else 1))
    columns = max(column for column, _ in blocks) + 1
    tallest = max(
        sum(len(rows) + 3.0 for c, rows in blocks if c == column) for column in range(columns)
    )
    figure, _ = style.panels(style.PANEL if columns == 1 else 9.6, 0.7 + 0.19 * tallest, 1, 1)
    figure.clear()
    labels = style.brief(names)
    for column, part in enumerate(figure.subfigures(1, columns, squeeze=False).ravel()):
        groups = [rows for c, rows in blocks if c == column]
        grid = part.subplots(
            len(groups),
            1,
            squeeze=False,
            gridspec_kw={"height_ratios": [len(r) + 0.6 for r in groups]},
        )
        for panel, rows in zip(grid.ravel(), groups, strict=True):
            every = np.array([v[rows] for v in values.values()])
            for row, of_row in enumerate(every.T):
                if np.isfinite(of_row).any():
                    panel.plot(
                        [np.nanmin(of_row), np.nanmax(of_row)],
                        [row, row],
                        color=style.DIM,
                        zorder=1,
                    )
            for look, v in values.items():
                style.dots(panel, v[rows], np.arange(len(rows)), look)
            style.log_axis(panel.xaxis, every)
            panel.set_yticks(range(len(rows)), [labels[i] for i in rows], fontsize=9)
            panel.set(ylim=(len(rows) - 0.4, -0.6), xlabel=f"[{units[rows[0]]}]")
            panel.tick_params(axis="x", labelsize=9)
            panel.grid(color=style.FAINT, linewidth=0.4)
    style.legend(figure)
    return figure


def _blocks(units: Sequence[str], columns: int) -> Iterator[tuple[int, list[int]]]:
    """Column and rows of each panel: parameters of one unit, cut where a column is full."""
    room, column, left = -(-len(units) // columns), 0, -(-len(units) // columns)
    for unit in dict.fromkeys(units):
        rows = [i for i, other in enumerate(units) if other == unit]
        while rows:
            if not left:
                column, left = column + 1, room
            yield column, rows[:left]
            rows, left = rows[left:], left - min(left, len(rows))


def _positive(values: Sequence[float | None]) -> Array:
    """Values as an array, NaN for what is none, or zero."""
    known = np.array(values, dtype=float)
    return np.where(np.isfinite(known) & (known > 0.0), known, np.nan)


@style.styled
def ellipses(result: Any) -> Figure | None:
    """95 % error ellipses of the pairs that a comparison found hardest to separate, #1 and #2."""
    plan = result.plans[0]
    pairs, units = plan.entangled, {p.id: p.unit for p in plan.points.parameters}
    if not pairs:
        return None
    across = min(_ACROSS, len(pairs))
    down = -(-len(pairs) // across)
    figure, every = style.panels(max(4.2, 3.1 * across), 0.6 + 2.9 * down, down, across)
    for panel, pair in zip(every, pairs, strict=False):
        for key, covariance in pair.covariance.items():
            look = _LOOKS[key]
            panel.plot(
                *ellipse(np.array(covariance, dtype=float)),
                color=look.color,
                linestyle=look.linestyle,
                label=look.label,
            )
        (x, y), (a, b) = style.brief(pair.ids), (units[name] for name in pair.ids)
        panel.set(xlabel=f"error of {x} [{a}]", ylabel=f"error of {y} [{b}]")
        panel.locator_params(nbins=4)
    for panel in every[len(pairs) :]:
        panel.remove()
    style.legend(figure)
    return figure


def ellipse(covariance: Array) -> Array:
    """Outline of the 95 % ellipse of a covariance (2, 2), shape (2, 145); NaN stays NaN."""
    turn = np.linspace(0.0, 2.0 * np.pi, 145)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    if not np.isfinite(covariance).all():
        return np.full_like(circle, np.nan)
    size, axes = np.linalg.eigh(covariance)
    out: Array = axes @ (_RADIUS * np.sqrt(np.clip(size, 0.0, None))[:, None] * circle)
    return out


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
