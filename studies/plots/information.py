"""Where the information comes from: share of each pose, derivative of each candidate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VECTOR = 2000  # candidates; a larger cloud becomes a picture within the SVG


@style.styled
def by_pose(pose_names: Sequence[str], shares: Sequence[Mapping[str, float]]) -> style.Picture:
    """Leverage of each pose as stacked bars; all bars sum to the number of parameters.

    shares : of each pose, effect -> how many of its parameters the pose determines; the same effects
    """
    groups = list(shares[0])
    parts = np.array([[own[group] for group in groups] for own in shares])
    look = style.looks(groups, solid=True)
    m = len(pose_names)
    figure = style.sheet(min(10.5, max(style.PANEL, 1.6 + 0.17 * m)), 3.9)
    panel = figure.subplots()
    style.tidy(panel, "y")
    below, many = np.zeros(m), len(groups) > 1
    bare: Any = {"edgecolor": "white", "linewidth": 0.0}
    for group, part in zip(groups, parts.T, strict=True):
        own: Any = {"color": look[group].color, "hatch": look[group].hatch if many else ""}
        panel.bar(range(m), part, 0.78, bottom=below, **bare, **own)
        below = below + part
    mean = float(parts.sum()) / m
    dashed: Any = {"color": "0.2", "linewidth": 1.0, "linestyle": style.DASHED}
    panel.axhline(mean, **dashed)
    style.pose_ticks(panel, pose_names)
    panel.set(xlabel="pose", ylabel="share of the information\n[parameters]", xlim=(-0.6, m - 0.4))
    handles = [
        style.patch_key(g, facecolor=look[g].color, hatch=look[g].hatch, **bare) for g in groups
    ]
    even = style.line_key("equal shares", **dashed)
    style.legend_below(figure, [*handles, even] if many else [even])
    total = parts.sum()
    caption = (
        f"How many of the {total:.3g} parameters each pose determines (its leverage); all bars add up "
        f"to {total:.3g}. A pose far above the dashed line ({mean:.2f}) carries the result: its "
        "loss costs most."
    )
    header = ("pose", *(f"{g} [parameters]" for g in groups), "share of all [%]")
    rows = tuple(
        (label, *map(style.cell, part), style.cell(100.0 * part.sum() / total if total else np.nan))
        for label, part in zip(pose_names, parts, strict=True)
    )
    return style.Picture(
        "information", "What each pose contributes to the parameters", caption, figure, header, rows
    )


@style.styled
def derivative(
    score: Array,
    angle: Array,
    joint: str,
    chosen: NDArray[np.int_],
    *,
    levels: Array | None = None,
    criterion: str = "D",
    efficiency: float | None = None,
) -> style.Picture:
    """Derivative of the criterion towards each candidate, over the angle of one joint.

    score : ndarray, shape (n,), scaled so that no candidate of an optimal design exceeds one, the bound
        of the equivalence theorem
    angle : ndarray, shape (n,), rad, of the joint at each candidate
    chosen : ndarray of int, shape (k,), candidates of the design
    levels : ndarray, shape (levels,), rad, where the joint may stand; candidates are then spread
        beside their level
    efficiency : proven share of the best value, 0 to 1
    """
    score, degrees = np.asarray(score, dtype=float), np.degrees(np.asarray(angle, dtype=float))
    chosen = np.asarray(chosen, dtype=int)
    marks = None if levels is None else np.degrees(np.sort(levels))
    at = degrees if marks is None else _spread(degrees, marks)
    figure = style.sheet(style.PANEL, 4.0)
    panel = figure.subplots()
    style.tidy(panel)
    crowd = _crowd(panel, at, score, np.setdiff1d(np.arange(len(score)), chosen))
    line: Any = {"color": style.VERMILLION, "linestyle": "--", "linewidth": 1.6}
    bar = panel.axhline(1.0, label="bound", **line)
    own, = panel.plot(
        at[chosen], score[chosen], color=style.BLUE, marker="D", markersize=6.5,
        markeredgecolor="white", markeredgewidth=0.8, linestyle="", label=f"chosen ({len(chosen)})",
    )  # fmt: skip
    if marks is not None:
        panel.set_xticks(
            marks, [f"{mark:g}".replace("-", "\N{MINUS SIGN}") for mark in marks.round(2)]
        )
    panel.set_xlabel(f"{joint} [deg]")
    panel.set_ylabel(f"derivative of criterion {criterion}\n[share of its bound]")
    low, high = float(score.min()), max(float(score.max()), 1.0)
    panel.set_ylim(low - 0.12 * (high - low), high + 0.12 * (high - low))
    proved = "" if efficiency is None else f"at least {100.0 * efficiency:.1f} %"
    if proved:
        panel.set_title(f"{proved} of the best", loc="right", color="0.2")
    style.legend_below(figure, [own, crowd, bar])
    reached = f"; this one reaches {proved}." if proved else "."
    caption = (
        f"How much criterion {criterion} would gain by turning effort towards each candidate. In the "
        f"best design no candidate lies above the dashed bound and the chosen poses lie on it{reached}"
    )
    header = ("chosen", f"{joint} [deg]", "derivative [-]", "bound [-]")
    rows = tuple((str(k), style.cell(degrees[k]), style.cell(score[k]), 1.0) for k in chosen)
    title = "How much each candidate pose would improve the plan"
    return style.Picture("derivative", title, caption, figure, header, rows)


def _crowd(panel: Axes, at: Array, score: Array, others: NDArray[np.int_]) -> Any:
    """The candidates that were not chosen; returns their entry in the legend."""
    dot: Any = {"color": "0.55", "marker": "o", "linestyle": "", "markeredgewidth": 0.0}
    many = len(others) > _VECTOR
    if many:
        panel.plot(at[others], score[others], markersize=1.2, rasterized=True, **dot)
    else:
        style.cloud(panel, at[others], score[others], 2.0, color=dot["color"], zorder=2)
    return style.line_key(f"candidates ({len(others)})", markersize=4.0, **dot)


def _spread(degrees: Array, marks: Array) -> Array:
    """Angles moved apart beside their level."""
    nearest = np.argmin(np.abs(degrees[:, None] - marks), axis=1)
    half = 0.3 * float(np.diff(marks).min()) if len(marks) > 1 else 1.0
    return style.aside(marks[nearest], 0.9 * half)
