"""What the parameters share: 95 % ellipses of pairs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Pair: TypeAlias = tuple[str, str, str, str]
"""Name and unit of one parameter, name and unit of another."""

_RADIUS = math.sqrt(-2.0 * math.log(0.05))  # of the 95 % ellipse of two normal variables
_STEPS = 145  # of an outline


@style.styled
def ellipses(pairs: Sequence[Pair], covariances: Mapping[str, Array]) -> style.Picture:
    """95 % error ellipses of pairs of parameters, one panel a pair, about the mean.

    pairs : the first parameter of each along x
    covariances : approach -> ndarray, shape (pairs, 2, 2), in these units; NaN where not estimable
    """
    look = style.looks(covariances)
    figure, panels = style.small_panels(
        len(pairs), 3, lambda a, b: (max(4.2, 3.1 * a), 0.7 + 3.0 * b)
    )
    for i, (pair, panel) in enumerate(zip(pairs, panels, strict=True)):
        _prepare(panel, pair)
        for key, covariance in covariances.items():
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
    header = ("pair", "approach", "std of first", "unit", "std of second", "unit", "correlation")
    rows = tuple(
        _row(pair, look[key].label, np.asarray(covariance, dtype=float)[i])
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


def _row(pair: Pair, approach: str, C: Array) -> tuple[style.Cell, ...]:
    """Both standard deviations and the correlation."""
    first, unit, second, other = pair
    a, b = (math.sqrt(max(C[k, k], 0.0)) for k in (0, 1))
    related = style.cell(C[0, 1] / (a * b)) if a * b > 0.0 else None
    return f"{first}, {second}", approach, style.cell(a), unit, style.cell(b), other, related


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
