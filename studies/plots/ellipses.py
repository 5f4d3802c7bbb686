"""What the parameters share: 95 % ellipses of pairs, and the map of all correlations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Pair: TypeAlias = tuple[str, str, str, str]
"""Name and unit of one parameter, name and unit of another."""

_RADIUS = math.sqrt(-2.0 * math.log(0.05))  # of the 95 % ellipse of two normal variables
_DRAWN = 400  # points of a cloud; more only make it darker
_LISTED = 20
_STEPS = 145  # of an outline
_STRONG = 0.9  # a correlation that is told of
_WRITTEN = 12  # parameters up to which the numbers stand in the cells


@style.styled
def ellipses(
    pairs: Sequence[Pair],
    covariances: Mapping[str, Array],
    samples: Mapping[str, Array] | None = None,
) -> style.Picture:
    """95 % error ellipses of pairs of parameters, one panel a pair, about the mean.

    pairs : the first parameter of each along x
    covariances : approach -> ndarray, shape (pairs, 2, 2), in these units; NaN where not estimable
    samples : approach -> ndarray, shape (trials, pairs, 2), simulated errors in these units
    """
    look = style.looks(covariances)
    samples = samples or {}
    figure, panels = style.small_panels(
        len(pairs), 3, lambda a, b: (max(4.2, 3.1 * a), 0.7 + 3.0 * b)
    )
    for i, (pair, panel) in enumerate(zip(pairs, panels, strict=True)):
        _prepare(panel, pair)
        for key, covariance in covariances.items():
            if key in samples:
                drawn = np.asarray(samples[key])[:_DRAWN, i]
                color = look[key].color
                style.cloud(panel, drawn[:, 0], drawn[:, 1], 2.2, color=color, alpha=0.7, zorder=1)
            outline = ellipse(np.asarray(covariance)[i])
            panel.plot(
                *outline.T, color=look[key].color, linestyle=look[key].linestyle, linewidth=1.8
            )
    style.legend_below(
        figure, [style.key_of(look[key], marker="", linewidth=1.8) for key in covariances]
    )
    caption = (
        "Each ellipse holds the error of both parameters in 95 % of experiments; smaller is better, "
        "a slanted one means that the two are estimated together."
    )
    if samples:
        caption += " Points are simulated experiments."
    header = (
        "pair", "approach", "std of first", "unit", "std of second", "unit", "correlation",
        "simulated inside [%]",
    )  # fmt: skip
    rows = tuple(
        _row(
            pair,
            look[key].label,
            np.asarray(covariance, dtype=float)[i],
            np.asarray(samples[key])[:, i] if key in samples else None,
        )
        for i, pair in enumerate(pairs)
        for key, covariance in covariances.items()
    )
    title = "Parameters that are hardest to tell apart: 95 % error ellipses"
    return style.Picture("ellipses", title, caption, figure, header, rows)


def _prepare(panel: Axes, pair: Pair) -> None:
    """Axes of a pair, with few ticks."""
    style.tidy(panel)
    labels = style.brief([pair[0], pair[2]])
    panel.set_xlabel(_label(labels[0], pair[1]))
    panel.set_ylabel(_label(labels[1], pair[3]))
    panel.tick_params(labelsize=9)
    panel.locator_params(axis="x", nbins=3)
    panel.locator_params(axis="y", nbins=4)


def _row(pair: Pair, approach: str, C: Array, samples: Array | None) -> tuple[style.Cell, ...]:
    """Both standard deviations, the correlation, and how many samples the ellipse holds."""
    first, unit, second, other = pair
    a, b = (math.sqrt(max(C[k, k], 0.0)) for k in (0, 1))
    related = style.cell(C[0, 1] / (a * b)) if a * b > 0.0 else None
    inside = math.nan if samples is None else share_inside(C, samples)
    return (
        f"{first}, {second}", approach, style.cell(a), unit, style.cell(b), other, related,
        style.cell(100.0 * inside),
    )  # fmt: skip


def _label(name: str, unit: str) -> str:
    """Label of an axis; the unit on a line of its own where the name is long."""
    return f"error of {name}{' ' if len(name) < 12 else chr(10)}[{unit}]"


def ellipse(covariance: Array) -> Array:
    """Outline of the 95 % ellipse of a covariance (2, 2), shape (145, 2); NaN stays NaN."""
    turn = np.linspace(0.0, 2.0 * np.pi, _STEPS)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if not np.isfinite(covariance).all():
        return np.full_like(circle, np.nan)
    size, axes = np.linalg.eigh(covariance)
    out: Array = _RADIUS * (circle * np.sqrt(np.clip(size, 0.0, None))) @ axes.T
    return out


def share_inside(covariance: Array, samples: Array) -> float:
    """Share of the samples (trials, 2) within the 95 % ellipse about zero."""
    if not np.isfinite(covariance).all() or np.linalg.det(covariance) <= 0.0:
        return math.nan
    squares = np.einsum("ti,ij,tj->t", samples, np.linalg.inv(covariance), samples)
    return float(np.mean(squares <= _RADIUS**2))


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
