"""What the fit leaves, against what it may depend on: joints, load, time, temperature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots.style import (
    BLUE,
    INK,
    SOFT,
    VERMILLION,
    Cell,
    Look,
    Picture,
    cell,
    dots,
    key_of,
    legend_below,
    sheet,
    styled,
    tidy,
)

_MM = 1e3
_COLUMNS = 4
_BINS = 6
_FEWEST = 3  # poses of a bin worth a median


@styled
def against(
    pose_names: Sequence[str],
    error: Array,
    variables: Mapping[str, Array],
    sigma: float,
    heldout: NDArray[np.bool_],
) -> Picture:
    """The error of each pose over each variable, one panel a variable, with medians of sixths.

    error : ndarray, shape (m,), m, RMS over the markers of the pose
    variables : label with unit -> ndarray, shape (m,); sigma : of one coordinate [m]
    heldout : ndarray of bool, shape (m,), poses that took no part in the fit
    """
    columns = min(_COLUMNS, len(variables))
    lines = -(-len(variables) // columns)
    figure = sheet(2.6 * columns + 0.4, 2.1 * lines + 0.7)
    axes = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for panel in axes.flat[len(variables) :]:
        panel.remove()
    shown = error * _MM
    looks = [
        Look("fitted poses", BLUE, "o", "", "", ""),
        *([Look("held-out poses", VERMILLION, "^", "", "", "")] if heldout.any() else []),
    ]
    size = 4.0 if len(error) <= 100 else 2.2
    rows: list[tuple[Cell, ...]] = []
    for panel, (label, values) in zip(axes.flat, variables.items(), strict=False):
        tidy(panel, "y")
        panel.axhline(np.sqrt(3.0) * sigma * _MM, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
        for look, mask in zip(looks, (~heldout, heldout), strict=False):
            own = [name for name, chosen in zip(pose_names, mask, strict=True) if chosen]
            dots(
                panel, own, values[mask], shown[mask], color=look.color, marker=look.marker,
                markersize=size, markeredgewidth=0.0, alpha=0.75,
            )  # fmt: skip
        centre, median = _medians(values, shown)
        panel.plot(centre, median, color=SOFT, linewidth=1.6, marker="_", markersize=9.0)
        panel.set(xlabel=label, ylim=(0.0, 1.08 * float(np.nanmax(shown))))
        rows.append((label, cell(_trend(values, shown)), cell(median.max()), cell(median.min())))
    for line in axes:
        line[0].set_ylabel("error of a pose [mm]")
    handles: list[Any] = [key_of(look) for look in looks]
    handles.append(key_of(Look("median of a sixth", SOFT, "_", "-", "", "")))
    handles.append(key_of(Look("noise alone", INK, "", (0, (4, 2)), "", "")))  # type: ignore[arg-type]
    legend_below(figure, handles)
    caption = (
        "RMS distance between measured and predicted markers of each pose. Where the model holds, the "
        "medians lie level near the dashed line; a slope or a bow points to what is not modelled."
    )
    header = ("against", "rank correlation [-]", "highest median [mm]", "lowest median [mm]")
    title = "The error that is left, over what it may depend on"
    return Picture("against", title, caption, figure, header, tuple(rows))


def _medians(values: Array, shown: Array) -> tuple[Array, Array]:
    """Medians of the error in sixths of the poses by the variable; one where it is constant."""
    order = np.argsort(values, kind="stable")
    count = max(1, min(_BINS, len(order) // _FEWEST, len(np.unique(values))))
    parts = np.array_split(order, count)
    return (
        np.array([np.median(values[part]) for part in parts]),
        np.array([np.median(shown[part]) for part in parts]),
    )


def _trend(values: Array, shown: Array) -> float:
    """Spearman's rank correlation, NaN where the variable is constant."""
    from scipy.stats import spearmanr

    if np.ptp(values) == 0.0 or np.ptp(shown) == 0.0:
        return float("nan")
    return float(spearmanr(values, shown).statistic)
