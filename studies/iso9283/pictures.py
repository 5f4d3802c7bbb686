"""AP and RP of each pose with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from studies.plots.style import (
    BLUE,
    PANEL,
    VERMILLION,
    Cell,
    Picture,
    legend_below,
    pose_ticks,
    sheet,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from calib.arrays import Array
    from studies.iso9283.record import Figure, Iso9283Record


@styled
def accuracy_and_repeatability(record: Iso9283Record) -> Picture:
    """Measured poses filled, predicted ones open; the interval as a line."""
    figure = sheet(PANEL, 5.0)
    panels = figure.subplots(2, 1, sharex=True)  # AP is often a hundred times RP
    handles = []
    measured = np.array([pose.how == "measured" for pose in record.poses])
    for panel, name, found, color, mark in (
        (panels[0], "AP", [pose.ap_mm for pose in record.poses], VERMILLION, "^"),
        (panels[1], "RP", [pose.rp_mm for pose in record.poses], BLUE, "o"),
    ):
        tidy(panel, "y")
        value, low, high = _columns(found)
        at = np.arange(len(value))
        panel.vlines(at, low, high, color=color, linewidth=0.8, alpha=0.6)
        for how, chosen, face in (
            ("measured", measured, color), ("predicted", ~measured, "none")
        ):  # fmt: skip
            here = chosen & np.isfinite(value)
            if here.any():
                handles += panel.plot(
                    at[here], value[here], color=color, markerfacecolor=face, marker=mark,
                    linestyle="", label=f"{name}, {how}",
                )  # fmt: skip
        panel.set(ylabel=f"{name} [mm]", ylim=(0.0, None))
    pose_ticks(panels[-1], [pose.pose for pose in record.poses])
    panels[-1].set_xlabel("pose")
    legend_below(figure, handles)
    caption = (
        f"Pose accuracy AP and pose repeatability RP of ISO 9283 at {record.marker}, with 95 % "
        "intervals: of the mean of the cycles and of their scatter where poses were repeated, of the "
        "identified arm where not."
    )
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (pose.pose, pose.approach, pose.how, *_numbers(pose.ap_mm), *_numbers(pose.rp_mm))
        for pose in record.poses
    )
    header = ("pose", "from", "how", "AP [mm]", "low", "high", "RP [mm]", "low", "high")
    return Picture(
        "iso9283",
        "Accuracy (AP) and repeatability (RP) of each pose, by ISO 9283",
        caption,
        figure,
        header,
        rows,
    )


def _numbers(found: Figure | None) -> tuple[float | None, float | None, float | None]:
    return (None, None, None) if found is None else (found.value, found.low, found.high)


def _columns(found: Sequence[Figure | None]) -> tuple[Array, Array, Array]:
    """Values and ends of intervals, NaN where there are none; an open end stays at its value."""
    rows = np.array([_numbers(own) for own in found], dtype=float)
    value = rows[:, 0]
    low, high = (np.where(np.isnan(rows[:, k]), value, rows[:, k]) for k in (1, 2))
    return value, low, high
