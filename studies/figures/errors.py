"""How far poses are off, before and after: pose by pose, over what it may depend on, step by step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from studies.figures.style import (
    BLUE,
    DASHED,
    GREEN,
    INK,
    PANEL,
    SOFT,
    VERMILLION,
    Look,
    dots,
    fixed,
    legend,
    log_axis,
    panels,
    pose_ticks,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calib.arrays import Array
    from studies.results.identify import IdentifyResult

_BEFORE = Look("before: nominal model", VERMILLION, "^")
_FITTED = Look("after, fitted poses", BLUE, "o")
_HELD = Look("after, held-out poses", GREEN, "D")
_NOISE = "noise of the instrument alone"
_LEAST = 1e-6  # mm: below it an error is drawn as none
_ACROSS, _MOST = 3, 6  # panels
_PARTS = 6  # of the poses, each with its median
_FEWEST = 3  # poses of a part


@styled
def errors_by_pose(result: IdentifyResult) -> Figure:
    """RMS error of each pose by the nominal and by the identified model, on a log axis."""
    rows = result.by_pose
    before, after = (np.maximum([getattr(r, n) for r in rows], _LEAST) for n in ("before", "after"))
    held, at = np.array([r.heldout for r in rows]), np.arange(len(rows))
    figure, (panel,) = panels(min(10.0, max(PANEL, 0.09 * len(rows))), 3.8)
    dots(panel, at, before, _BEFORE)
    dots(panel, at[~held], after[~held], _FITTED)
    if held.any():
        dots(panel, at[held], after[held], _HELD)
    floor = max(math.sqrt(3.0) * result.noise.instrument_mm, _LEAST)
    _noise(panel, floor)
    panel.set(xlabel="pose", ylabel="RMS error [mm]")
    log_axis(panel.yaxis, [*before, *after, floor])
    pose_ticks(panel, [r.pose for r in rows])
    legend(figure)
    return figure


@styled
def errors_against(
    result: IdentifyResult, variables: Mapping[str, Mapping[tuple[str, bool], float]]
) -> Figure | None:
    """The error that is left at each pose over the six variables that it follows most.

    variables : label with unit -> (pose, whether held out) -> value; None without any
    """
    rows = [r for r in result.by_pose if all((r.pose, r.heldout) in v for v in variables.values())]
    if not rows or not variables:
        return None
    error, held = np.array([r.after for r in rows]), np.array([r.heldout for r in rows])
    columns = {
        label: np.array([values[r.pose, r.heldout] for r in rows])
        for label, values in variables.items()
    }
    most = sorted(columns, key=lambda label: -abs(_rank_correlation(columns[label], error)))[:_MOST]
    columns = {label: x for label, x in columns.items() if label in most}
    across = min(_ACROSS, len(columns))
    down = -(-len(columns) // across)
    figure, every = panels(2.4 * across + 0.3, 1.9 * down + 0.6, down, across, sharey=True)
    fixed(figure, (0.65, 1.05, 0.1, 0.1), (0.15, 0.5))
    for panel, (label, x) in zip(every, columns.items(), strict=False):
        for look, mask in ((_FITTED, ~held), (_HELD, held)):
            if mask.any():
                dots(panel, x[mask], error[mask], look, markersize=3.0, alpha=0.75)
        panel.plot(*_medians(x, error), color=SOFT, marker="_", markersize=9.0, label="median")
        _noise(panel, math.sqrt(3.0) * result.noise.instrument_mm)
        panel.set(xlabel=label, ylim=(0.0, 1.08 * error.max()))
    for panel in every[len(columns) :]:
        panel.remove()
    for panel in every[::across]:
        panel.set_ylabel("RMS error [mm]")
    legend(figure)
    return figure


def _noise(panel: Axes, level: float) -> None:
    panel.axhline(level, color=INK, linewidth=1.0, linestyle=DASHED, label=_NOISE)


def _medians(x: Array, error: Array) -> tuple[list[float], list[float]]:
    """Medians of both in parts of the poses by x; one where it is constant."""
    order = np.argsort(x, kind="stable")
    count = max(1, min(_PARTS, len(order) // _FEWEST, len(np.unique(x))))
    parts = np.array_split(order, count)
    return [float(np.median(x[p])) for p in parts], [float(np.median(error[p])) for p in parts]


def _rank_correlation(x: Array, y: Array) -> float:
    """Spearman's, ties in their order; zero where either is constant."""
    a, b = (np.argsort(np.argsort(values, kind="stable"), kind="stable") for values in (x, y))
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(x) > 0.0 and np.ptp(y) > 0.0 else 0.0


def draw_steps(panel: Axes, steps: Sequence[tuple[str, float]], floor: float) -> None:
    """Errors after each step of a calibration, mm, on a log axis; floor : noise alone, mm."""
    for row, (_, value) in enumerate(steps):
        panel.plot([floor / 2.0, value], [row, row], color=BLUE if row else VERMILLION, linewidth=9.0,
                   solid_capstyle="butt")  # fmt: skip
        panel.annotate(
            f"{value:#.2g} mm", (value, row), (6, 0), textcoords="offset points", va="center"
        )
    panel.axvline(floor, color=INK, linewidth=1.2, linestyle=DASHED)
    panel.annotate(
        "noise", (floor, -0.62), (5, 0), textcoords="offset points", va="center", color=SOFT
    )
    log_axis(panel.xaxis, [floor / 2.0, 3.0 * max(value for _, value in steps)])
    panel.set_yticks(range(len(steps)), [label for label, _ in steps])
    panel.set(ylim=(len(steps) - 0.4, -0.75), xlabel="RMS error at held-out poses [mm]")
    panel.grid(False, axis="y")
