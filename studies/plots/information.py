"""Where the information comes from: the share of each pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from studies.plots import style


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
