"""How far poses are off, before and after: pose by pose, over what it may depend on, step by step."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.arrays import Array
from studies.figures import style
from studies.results.identify import IdentifyResult

_BEFORE = style.Look("before: nominal model", style.VERMILLION, "^")
_FITTED = style.Look("after, fitted poses", style.BLUE, "o")
_HELD = style.Look("after, held-out poses", style.GREEN, "D")
_NOISE = "noise of the instrument alone"
_LEAST = 1e-6  # mm: below it an error is drawn as none
_ACROSS, _MOST = 2, 6  # panels: two beside each other are legible on a phone
_PARTS = 6  # of the poses, each with its median
_FEWEST = 3  # poses of a part


@style.styled
def errors_by_pose(result: IdentifyResult) -> Figure:
    """RMS error of each pose by the nominal and by the identified model, on a log axis."""
    rows = result.by_pose
    before, after = (np.maximum([getattr(r, n) for r in rows], _LEAST) for n in ("before", "after"))
    held, at = np.array([r.heldout for r in rows]), np.arange(len(rows))
    figure, (panel,) = style.panels(min(10.0, max(style.PANEL, 0.09 * len(rows))), 3.8)
    style.dots(panel, at, before, _BEFORE)
    style.dots(panel, at[~held], after[~held], _FITTED)
    if held.any():
        style.dots(panel, at[held], after[held], _HELD)
    floor = max(math.sqrt(3.0) * result.noise.instrument_mm, _LEAST)
    _noise(panel, floor)
    panel.set(xlabel="pose", ylabel="RMS error [mm]")
    style.log_axis(panel.yaxis, [*before, *after, floor])
    style.pose_ticks(panel, [r.pose for r in rows])
    style.legend(figure)
    return figure


@style.styled
def errors_against(result: IdentifyResult) -> Figure | None:
    """The error that is left at each pose over the six variables that it follows most."""
    known = {(row.pose, row.heldout): row.variables for row in result.conditions}
    rows = [row for row in result.by_pose if (row.pose, row.heldout) in known]
    if not rows:
        return None
    error, held = np.array([r.after for r in rows]), np.array([r.heldout for r in rows])
    of_rows = [known[row.pose, row.heldout] for row in rows]
    shared = [label for label in of_rows[0] if all(label in own for own in of_rows)]
    every = {label: np.array([own[label] for own in of_rows]) for label in shared}
    every = {label: x for label, x in every.items() if np.ptp(x) > 0.0}
    most = sorted(every, key=lambda label: -abs(_rank_correlation(every[label], error)))[:_MOST]
    columns = {label: x for label, x in every.items() if label in most}
    if not columns:
        return None
    across = min(_ACROSS, len(columns))
    down = -(-len(columns) // across)
    figure, grid = style.panels(2.4 * across + 0.3, 1.9 * down + 0.6, down, across, sharey=True)
    style.fixed(figure, (0.65, 1.05, 0.1, 0.1), (0.15, 0.5))
    for panel, (label, x) in zip(grid, columns.items(), strict=False):
        for look, mask in ((_FITTED, ~held), (_HELD, held)):
            if mask.any():
                style.dots(panel, x[mask], error[mask], look, markersize=3.0, alpha=0.75)
        panel.plot(
            *_medians(x, error), color=style.SOFT, marker="_", markersize=9.0, label="median"
        )
        _noise(panel, math.sqrt(3.0) * result.noise.instrument_mm)
        panel.set(xlabel=label, ylim=(0.0, 1.08 * error.max()))
    for panel in grid[len(columns) :]:
        panel.remove()
    for panel in grid[::across]:
        panel.set_ylabel("RMS error [mm]")
    style.legend(figure)
    return figure


def _noise(panel: Axes, level: float) -> None:
    panel.axhline(level, color=style.INK, linewidth=1.0, linestyle=style.DASHED, label=_NOISE)


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
