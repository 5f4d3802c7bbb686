"""What the parameters share: the map of all correlations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LISTED = 20
_STRONG = 0.9  # a correlation that is told of
_WRITTEN = 12  # parameters up to which the numbers stand in the cells


@style.styled
def correlation(names: Sequence[str], matrix: Array) -> style.Picture:
    """Map of the correlations, blue to red from -1 to 1, the strongest pairs in the table.

    names : of the p parameters; those of one effect, ``effect:..``, stand in one bracket
    matrix : ndarray, shape (p, p), correlations or a covariance; NaN where not estimable
    """
    R = correlations(matrix)
    count = len(names)
    side = 1.9 + max(0.18 * count, 0.42 * min(count, _WRITTEN))
    figure = style.sheet(side + 1.9, side, "compressed")
    panel = figure.subplots()
    panel.set_facecolor("0.92")  # where there is no value
    image = panel.imshow(R, cmap="RdBu_r", vmin=-1.0, vmax=1.0, interpolation="nearest")
    labels = style.brief(names)
    panel.set_xticks(range(count), labels, rotation=90, fontsize=9)
    panel.set_yticks(range(count), labels, fontsize=9)
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    if count <= _WRITTEN:
        _write(panel, R)
    _brackets(panel, [n.split(":")[0] if ":" in n else "" for n in names])
    bar = figure.colorbar(image, ax=panel, shrink=0.6, aspect=30, ticks=[-1, -0.5, 0, 0.5, 1])
    bar.set_label("correlation [-]")
    bar.outline.set_visible(False)
    first, second = np.triu_indices(count, 1)
    values = R[first, second]
    order = np.argsort(-np.abs(np.nan_to_num(values)), kind="stable")[:_LISTED]
    rows = tuple((names[first[k]], names[second[k]], style.cell(values[k])) for k in order)
    caption = "Correlation of the estimates of each two parameters: white is none, dark is one. "
    if len(order) and np.isfinite(values[order[0]]):
        k = order[0]
        caption += (
            f"The strongest pair is {names[first[k]]} and {names[second[k]]} with {values[k]:+.2f}; "
            f"{int(np.sum(np.abs(values) > _STRONG))} of {len(values)} pairs exceed {_STRONG:g}."
        )
    header = ("parameter", "parameter", "correlation")
    strong = int(np.sum(np.abs(values) > _STRONG))
    title = f"{strong or 'No'} of {len(values)} pairs of parameters correlate beyond {_STRONG:g}"
    return style.Picture("correlation", title, caption, figure, header, rows)


def correlations(matrix: Array) -> Array:
    """Correlations of a covariance or correlation matrix (p, p); NaN where a variance is none."""
    matrix = np.asarray(matrix, dtype=float)
    variance = np.diagonal(matrix)
    std = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    out: Array = np.clip(matrix / np.outer(std, std), -1.0, 1.0)
    return out


def _write(panel: Axes, R: Array) -> None:
    """Numbers in the cells, white on dark ones."""
    for (i, j), value in np.ndenumerate(R):
        if i != j and np.isfinite(value):
            color = style.ON_DARK if abs(value) > 0.65 else style.ON_LIGHT
            panel.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=9, color=color)


def _brackets(panel: Axes, groups: Sequence[str]) -> None:
    """Lines between groups of neighbours, their names at the right."""
    place: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
    start = 0
    for group, members in groupby(groups):
        end = start + len(list(members))
        if start:
            panel.axhline(start - 0.5, color=style.SOFT, linewidth=0.9)
            panel.axvline(start - 0.5, color=style.SOFT, linewidth=0.9)
        if group:
            panel.plot(
                [1.012, 1.012], [start - 0.35, end - 0.65], color=style.SOFT, linewidth=1.5,
                transform=panel.get_yaxis_transform(), clip_on=False,
            )  # fmt: skip
            middle = (start + end - 1) / 2.0
            panel.annotate(
                group.replace("_", " "), (1.012, middle), (5.0, 0.0), va="center", fontsize=9,
                color=style.INK, annotation_clip=False, **place,
            )  # fmt: skip
        start = end
