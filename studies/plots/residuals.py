"""What the fit leaves, against what it may depend on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    pass


_MM = 1e3
_COLUMNS = 4
_BINS = 6
_FEWEST = 3  # poses of a bin worth a median
_FITTED = style.Look("fitted poses", style.BLUE, "o")
_HELD = style.Look("held-out poses", style.VERMILLION, "^")
_MEDIAN = style.Look("median of a sixth", style.SOFT, "_", "-")
_NOISE = style.Look("noise alone", style.INK, "", style.DASHED)


@style.styled
def against(
    error: Array,
    variables: Mapping[str, Array],
    sigma: float,
    heldout: NDArray[np.bool_],
) -> style.Picture:
    """The error of each pose over each variable, one panel a variable, with medians of sixths.

    error : ndarray, shape (m,), m, RMS over the markers of the pose
    variables : label with unit -> ndarray, shape (m,); sigma : of one coordinate [m]
    heldout : ndarray of bool, shape (m,), poses that took no part in the fit
    """
    figure, panels = style.small_panels(
        len(variables), _COLUMNS, lambda a, b: (2.6 * a + 0.4, 2.1 * b + 0.7), sharey=True
    )
    shown = error * _MM
    looks = [_FITTED, *([_HELD] if heldout.any() else [])]
    size = 4.0 if len(error) <= 100 else 2.2
    rows: list[tuple[style.Cell, ...]] = []
    for panel, (label, values) in zip(panels, variables.items(), strict=True):
        style.tidy(panel, "y")
        panel.axhline(
            np.sqrt(3.0) * sigma * _MM, color=style.INK, linewidth=1.0, linestyle=style.DASHED
        )
        for look, mask in zip(looks, (~heldout, heldout), strict=False):
            style.dots(
                panel, values[mask], shown[mask], color=look.color, marker=look.marker,
                markersize=size, markeredgewidth=0.0, alpha=0.75,
            )  # fmt: skip
        centre, median = _medians(values, shown)
        panel.plot(centre, median, color=style.SOFT, linewidth=1.6, marker="_", markersize=9.0)
        panel.set(xlabel=label, ylim=(0.0, 1.08 * float(np.nanmax(shown))))
        rows.append(
            (
                label,
                style.cell(_trend(values, shown)),
                style.cell(median.max()),
                style.cell(median.min()),
            )
        )
    for panel in panels[::_COLUMNS]:
        panel.set_ylabel("error of a pose [mm]")
    style.legend_below(figure, [style.key_of(look) for look in (*looks, _MEDIAN, _NOISE)])
    caption = (
        "RMS distance between measured and predicted markers of each pose. Where the model holds, the "
        "medians lie level near the dashed line; a slope or a bow points to what is not modelled."
    )
    header = ("against", "rank correlation [-]", "highest median [mm]", "lowest median [mm]")
    title = "The error that is left, over what it may depend on"
    return style.Picture("against", title, caption, figure, header, tuple(rows))


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
