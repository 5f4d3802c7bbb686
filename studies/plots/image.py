"""Where in the image a camera is predicted wrongly: a field of arrows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from calib.arrays import Array
from studies.plots.style import BLUE, FAINT, INK, Cell, Picture, sheet, styled, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHARE = 0.05  # of the image: the length of an arrow of the 95th percentile


@styled
def over_image(fields: Mapping[str, tuple[Array, Array, tuple[str, ...]]]) -> Picture:
    """Measured minus predicted over the image, one panel a camera, all arrows magnified alike.

    fields : camera -> where, off (n, 2), px, and the names of the readings
    """
    figure = sheet(min(10.5, 1.2 + 4.6 * len(fields)), 4.9)
    axes = np.atleast_1d(figure.subplots(1, len(fields), squeeze=False)[0])
    size = np.concatenate([np.linalg.norm(off, axis=1) for _, off, _ in fields.values()])
    span = max(float(np.ptp(at, axis=0).max()) for at, _, _ in fields.values()) or 1.0
    times = _SHARE * span / max(float(np.quantile(size, 0.95)), 1e-12)
    times = float(f"{times:.1g}")
    for panel, (name, (at, off, _)) in zip(axes, fields.items(), strict=True):
        _field(panel, at, off, times)
        rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
        panel.set_title(
            f"{name}: {rms:.3g} px RMS, arrows {times:g} times as long", fontsize=9, color=INK
        )
    axes[0].set_ylabel("v [px]")
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name, reading, float(at[i, 0]), float(at[i, 1]), float(off[i, 0]), float(off[i, 1]))
        for name, (at, off, readings) in fields.items()
        for i, reading in enumerate(readings)
    )
    return Picture(
        "image",
        "Measured minus predicted over the image of each camera",
        f"Measured minus predicted, arrows {times:g} times as long as they are. A pattern that follows "
        "the image is the lens's; one that does not is the arm's or the board's.",
        figure,
        ("camera", "reading", "u [px]", "v [px]", "du [px]", "dv [px]"),
        rows,
    )


def _field(panel: Axes, at: Array, off: Array, times: float) -> None:
    moved = off * times
    panel.quiver(
        *at.T, *moved.T, angles="xy", scale_units="xy", scale=1.0, color=BLUE, width=0.0025,
        headwidth=4.0, headlength=5.0,
    )  # fmt: skip
    panel.plot(*at.T, ".", markersize=2.0, color=FAINT, zorder=0)
    panel.set_aspect("equal", adjustable="datalim")
    panel.invert_yaxis()
    panel.set_xlabel("u [px]")
    panel.margins(0.08)
    tidy(panel)
