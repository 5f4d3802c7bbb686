"""Where cameras saw boards: which part of the image, how far away, and how much it leant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ACROSS, _DOWN = 8, 6  # fields of an image


@dataclass(frozen=True, eq=False)
class BoardViews:
    """A board as one camera saw it, at k poses.

    at : ndarray, shape (n, 2), px, all of its points; distance, tilt : ndarray, shape (k,), m and rad,
        of its middle along the line of sight, and between that line and its normal
    """

    camera: str
    board: str
    image: Array
    at: Array
    distance: Array
    tilt: Array

    @property
    def fields(self) -> Array:
        """Points in each field of the image, shape (8, 6)."""
        counts = [_ACROSS, _DOWN]
        ends = [(0.0, float(size)) for size in self.image]
        return np.histogramdd(self.at, bins=counts, range=ends)[0]


@style.styled
def seen_where(views: Sequence[BoardViews]) -> style.Picture:
    """A row for each camera: points over the image, and distance and tilt of the boards."""
    cameras = list(dict.fromkeys(own.camera for own in views))
    look = style.looks(list(dict.fromkeys(own.board for own in views)))
    figure = style.sheet(9.0, 3.2 * len(cameras) + 0.5)
    axes = figure.subplots(len(cameras), 2, squeeze=False)
    rows = []
    for (image, aside), camera in zip(axes, cameras, strict=True):
        own = [view for view in views if view.camera == camera]
        fields = np.sum([view.fields for view in own], axis=0)
        covered = float((fields > 0).mean())
        _over_image(image, own[0].image, fields)
        image.set_title(
            f"{camera}: {100 * covered:.0f} % of the image", fontsize=9, color=style.INK
        )
        style.tidy(aside)
        for view in own:
            own_look: Any = {"color": look[view.board].color, "marker": look[view.board].marker}
            aside.plot(
                np.degrees(view.tilt), view.distance, linestyle="", markersize=4.5, **own_look
            )
            span = [
                *np.degrees(np.quantile(view.tilt, [0, 1])),
                *np.quantile(view.distance, [0, 1]),
            ]
            rows.append(
                (
                    camera,
                    view.board,
                    len(view.tilt),
                    style.cell(100 * covered),
                    *map(style.cell, span),
                )
            )
        aside.set(xlabel="tilt [deg]", ylabel="distance [m]", xlim=(0.0, 90.0))
        aside.set_ylim(bottom=0.0)
    style.legend_below(figure, [style.key_of(own, linestyle="") for own in look.values()])
    return style.Picture(
        "coverage",
        "Where the boards were seen",
        "Left: points in each field of the image; a lens is known where it was tried, so its corners "
        "should be covered. Right: each board at each pose. Several distances and tilts tell focal "
        "length, lens and the camera's place apart.",
        figure,
        ("camera", "board", "poses", "image covered [%]", "least tilt [deg]", "largest tilt [deg]",
         "nearest [m]", "farthest [m]"),
        tuple(rows),
    )  # fmt: skip


def _over_image(panel: Axes, size: Array, fields: Array) -> None:
    edges = (np.linspace(0.0, size[0], _ACROSS + 1), np.linspace(0.0, size[1], _DOWN + 1))
    shades = np.where(fields > 0, fields, np.nan).T
    drawn = panel.pcolormesh(*edges, shades, cmap="Blues", vmin=0.0, edgecolors="face")
    panel.figure.colorbar(drawn, ax=panel, label="points", fraction=0.04)
    panel.set_facecolor("none")
    panel.set_aspect("equal")
    panel.set(xlim=(0.0, size[0]), ylim=(size[1], 0.0), xlabel="u [px]", ylabel="v [px]")
    for spine in panel.spines.values():
        spine.set(visible=True, color=style.SOFT)
