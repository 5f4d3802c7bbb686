"""AP and RP of each pose with their intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from studies.plots import style
from studies.plots.errors import over_poses

if TYPE_CHECKING:
    from studies.iso9283.record import CriterionEntry, Iso9283Record


@style.styled
def accuracy_and_repeatability(record: Iso9283Record) -> style.Picture:
    """Measured poses filled, predicted ones open; the interval as a line."""
    figure = style.sheet(style.PANEL, 5.0)
    panels = figure.subplots(2, 1, sharex=True)  # AP is often a hundred times RP
    handles: list[Any] = []
    names = [pose.pose for pose in record.poses]
    for panel, name, color, mark, found in (
        (panels[0], "AP", style.VERMILLION, "^", [pose.ap_mm for pose in record.poses]),
        (panels[1], "RP", style.BLUE, "o", [pose.rp_mm for pose in record.poses]),
    ):
        values = np.array([_numbers(own) for own in found], dtype=float).T
        values[1:] = np.where(np.isnan(values[1:]), values[0], values[1:])  # an open end
        series = []
        for how, face in (("measured", color), ("predicted", "none")):
            own = np.array([pose.how == how for pose in record.poses])
            look = style.Look(f"{name}, {how}", color, mark, "", "", "", face)
            if (own & np.isfinite(values[0])).any():
                series.append((look, np.where(own, values, np.nan)))
        handles += over_poses(panel, names, series, f"{name} [mm]")
    style.legend_below(figure, handles)
    caption = (
        f"Pose accuracy AP and pose repeatability RP of ISO 9283 at {record.marker}, with 95 % "
        "intervals: of the mean of the cycles and of their scatter where poses were repeated, of the "
        "identified arm where not."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (pose.pose, pose.approach, pose.how, *_numbers(pose.ap_mm), *_numbers(pose.rp_mm))
        for pose in record.poses
    )
    header = ("pose", "from", "how", "AP [mm]", "low", "high", "RP [mm]", "low", "high")
    return style.Picture(
        "iso9283",
        "Accuracy (AP) and repeatability (RP) of each pose, by ISO 9283",
        caption,
        figure,
        header,
        rows,
    )


def _numbers(found: CriterionEntry | None) -> tuple[float | None, float | None, float | None]:
    return (None, None, None) if found is None else (found.value, found.low, found.high)
