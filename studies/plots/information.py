"""Where the information comes from: share of each pose, derivative of each candidate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots.style import (
    BLUE,
    VERMILLION,
    Picture,
    cell,
    cloud,
    legend_below,
    looks,
    pose_ticks,
    sheet,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VECTOR = 2000  # candidates; a larger cloud becomes a picture within the SVG


@styled
def by_pose(
    pose_names: Sequence[str],
    shares: Array,
    groups: Sequence[str] = ("parameters",),
    *,
    name: str = "information",
    title: str = "Information by pose",
) -> Picture:
    """Leverage of each pose as stacked bars; all bars sum to the number of parameters.

    shares : ndarray, shape (m,) or (m, groups), parameters determined by each pose
    groups : names of the groups of parameters
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    parts = np.asarray(shares, dtype=float).reshape(len(pose_names), len(groups))
    look = looks(groups, solid=True)
    m = len(pose_names)
    figure = sheet(min(10.5, max(4.8, 1.6 + 0.17 * m)), 3.9)
    panel = figure.subplots()
    tidy(panel, "y")
    below, many = np.zeros(m), len(groups) > 1
    for group, part in zip(groups, parts.T, strict=True):
        own: Any = {"color": look[group].color, "hatch": look[group].hatch if many else ""}
        panel.bar(range(m), part, 0.78, bottom=below, edgecolor="white", linewidth=0.0, **own)
        below = below + part
    mean = float(parts.sum()) / m
    panel.axhline(mean, color="0.2", linewidth=1.0, linestyle=(0, (4, 2)))
    pose_ticks(panel, pose_names)
    panel.set(xlabel="pose", ylabel="share of the information\n[parameters]", xlim=(-0.6, m - 0.4))
    handles = [
        Patch(
            facecolor=look[g].color, hatch=look[g].hatch, edgecolor="white", linewidth=0.0, label=g
        )
        for g in groups
    ]
    even = Line2D([], [], color="0.2", linewidth=1.0, linestyle=(0, (4, 2)), label="equal shares")
    legend_below(figure, [*handles, even] if many else [even])
    total = parts.sum()
    caption = (
        f"How many of the {total:.3g} parameters each pose determines (its leverage); all bars add up "
        f"to {total:.3g}. A pose far above the dashed line ({mean:.2f}) carries the result: its "
        "loss costs most."
    )
    header = ("pose", *(f"{g} [parameters]" for g in groups), "share of all [%]")
    rows = tuple(
        (label, *map(cell, part), cell(100.0 * part.sum() / total if total else np.nan))
        for label, part in zip(pose_names, parts, strict=True)
    )
    return Picture(name, title, caption, figure, header, rows)


@styled
def derivative(
    score: Array,
    angle: Array,
    joint: str,
    chosen: NDArray[np.int_],
    *,
    chosen_names: Sequence[str] | None = None,
    levels: Array | None = None,
    bound: float | Array = 1.0,
    criterion: str = "D",
    efficiency: float | None = None,
    name: str = "derivative",
    title: str = "Directional derivative of the design",
) -> Picture:
    """Derivative of the criterion towards each candidate, over the angle of one joint.

    score : ndarray, shape (n,), scaled so that no candidate of an optimal design exceeds the bound
    angle : ndarray, shape (n,), rad, of the joint at each candidate
    chosen : ndarray of int, shape (k,), candidates of the design
    levels : ndarray, shape (levels,), rad, where the joint may stand; candidates are then spread
        beside their level
    bound : 1 by the equivalence theorem, or ndarray, shape (levels,), one for each level
    efficiency : proven share of the best value, 0 to 1
    """
    score, degrees = np.asarray(score, dtype=float), np.degrees(np.asarray(angle, dtype=float))
    chosen = np.asarray(chosen, dtype=int)
    marks, limits = _bounds(degrees, levels, bound)
    at = degrees if levels is None or marks is None else _spread(degrees, marks)
    figure = sheet(6.8, 4.3)
    panel = figure.subplots()
    tidy(panel)
    crowd = _crowd(panel, at, score, np.setdiff1d(np.arange(len(score)), chosen))
    bar = _bar(panel, marks, limits)
    own, = panel.plot(
        at[chosen], score[chosen], color=BLUE, marker="D", markersize=6.5, markeredgecolor="white",
        markeredgewidth=0.8, linestyle="", label=f"chosen ({len(chosen)})",
    )  # fmt: skip
    if marks is not None:
        panel.set_xticks(
            marks, [f"{mark:g}".replace("-", "\N{MINUS SIGN}") for mark in marks.round(2)]
        )
    panel.set_xlabel(f"{joint} [deg]")
    one = "" if limits.size > 1 else ", bound = 1"
    panel.set_ylabel(f"derivative of {criterion}{one} [-]")
    low, high = float(score.min()), max(float(score.max()), float(limits.max()))
    panel.set_ylim(low - 0.12 * (high - low), high + 0.12 * (high - low))
    proved = "" if efficiency is None else f"at least {100.0 * efficiency:.1f} %"
    if proved:
        panel.set_title(f"{proved} of the best", loc="right", color="0.2")
    legend_below(figure, [own, crowd, bar])
    reached = f"; this one reaches {proved}." if proved else "."
    caption = (
        f"How much criterion {criterion} would gain by turning effort towards each candidate. In the "
        f"best design no candidate lies above the dashed bound and the chosen poses lie on it{reached}"
    )
    nearest = _nearest(degrees[chosen], marks)
    at_level = np.broadcast_to(limits, (1 if marks is None else len(marks),))[nearest]
    header = ("chosen", f"{joint} [deg]", "derivative [-]", "bound [-]")
    labels = chosen_names or [str(index) for index in chosen]
    values = zip(labels, degrees[chosen], score[chosen], at_level, strict=True)
    rows = tuple((label, *map(cell, numbers)) for label, *numbers in values)
    return Picture(name, title, caption, figure, header, rows)


def _bounds(
    degrees: Array, levels: Array | None, bound: float | Array
) -> tuple[Array | None, Array]:
    """Angles at which candidates stand, None where anywhere; the bound at each, or the only one."""
    limits = np.atleast_1d(np.asarray(bound, dtype=float))
    if levels is None:
        return np.unique(degrees) if limits.size > 1 else None, limits
    order = np.argsort(np.asarray(levels))
    marks = np.degrees(np.asarray(levels, dtype=float))[order]
    return marks, limits[order] if limits.size > 1 else limits


def _crowd(panel: Axes, at: Array, score: Array, others: NDArray[np.int_]) -> Any:
    """The candidates that were not chosen; returns their entry in the legend."""
    from matplotlib.lines import Line2D

    dot: Any = {"color": "0.55", "marker": "o", "linestyle": "", "markeredgewidth": 0.0}
    many = len(others) > _VECTOR
    if many:
        panel.plot(at[others], score[others], markersize=1.2, rasterized=True, **dot)
    else:
        cloud(panel, at[others], score[others], 2.0, color=dot["color"], zorder=2)
    return Line2D([], [], label=f"candidates ({len(others)})", markersize=4.0, **dot)


def _bar(panel: Axes, marks: Array | None, limits: Array) -> Any:
    """The bound: one line, or one at each level."""
    line: Any = {"color": VERMILLION, "linestyle": "--", "linewidth": 1.6}
    if marks is None or limits.size == 1:
        return panel.axhline(limits[0], label="bound", **line)
    half = _half_width(marks)
    return panel.hlines(limits, marks - half, marks + half, label="bound at the level", **line)


def _nearest(degrees: Array, marks: Array | None) -> NDArray[np.int_]:
    """The mark next to each angle."""
    if marks is None:
        return np.zeros(len(degrees), dtype=int)
    nearest: NDArray[np.int_] = np.argmin(np.abs(degrees[:, None] - marks), axis=1)
    return nearest


def _half_width(marks: Array) -> float:
    """Half the width of the strip in which the candidates of a level are drawn."""
    return 0.3 * float(np.diff(marks).min()) if len(marks) > 1 else 1.0


def _spread(degrees: Array, marks: Array) -> Array:
    """Angles moved apart beside their level, by a golden-ratio sequence: even and repeatable."""
    golden = (np.arange(len(degrees)) * 0.6180339887498949) % 1.0
    out: Array = marks[_nearest(degrees, marks)] + 0.9 * _half_width(marks) * (2.0 * golden - 1.0)
    return out
