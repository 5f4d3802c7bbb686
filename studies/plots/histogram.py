"""How far the points are off: before and after, with the figures that certificates state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calib.arrays import Array
from studies.plots.style import (
    BLUE,
    INK,
    PANEL,
    VERMILLION,
    Cell,
    Picture,
    cell,
    legend_below,
    log_ticks,
    sheet,
    short,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MM = 1e3
_MODELS = ("nominal model, base and markers fitted", "identified model")
_BINS_A_DECADE = 8
_BELOW = 0.005  # of the points may lie left of the axis, and count in the first bin
_DECADES = 1e-7  # shown at most, of the largest
_MEAN: Any = {"color": INK, "linewidth": 1.6, "linestyle": ":"}
_P95: Any = {"color": INK, "marker": "^", "markersize": 7.0, "linestyle": ""}
_FLOOR: Any = {"color": INK, "linewidth": 1.2, "linestyle": (0, (4, 2))}
_NOISE = 2.795483  # 95 % of |noise| / sigma in three coordinates (chi with 3 degrees of freedom)


@styled
def histogram(before: Array, after: Array, sigma: float) -> Picture:
    """Histograms of the 3-D distances before and after, one above the other, on one log axis.

    before, after : ndarray, shape (n, 3), m, measured minus predicted; sigma : of one coordinate [m]

    Raises ValueError where neither a distance nor sigma is above zero.
    """
    from matplotlib.lines import Line2D

    lengths = [np.linalg.norm(part, axis=-1) * _MM for part in (before, after)]
    low, high = _limits(np.concatenate(lengths), sigma * _MM)
    count = max(6, round(_BINS_A_DECADE * np.log10(high / low)))
    edges = np.geomspace(low, high, count + 1)
    figure = sheet(PANEL, 4.0)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    looks: Any = ({"color": VERMILLION, "hatch": "//"}, {"color": BLUE})
    for panel, own, label, look in zip(panels, lengths, _MODELS, looks, strict=True):
        tidy(panel, "y")
        panel.hist(np.clip(own, low, high), edges, edgecolor="white", linewidth=0.0, **look)
        panel.set(xscale="log", xlim=(low, high), ylabel="points")
        panel.set_title(label, loc="left")
        _mark(panel, own)
        panel.axvline(_NOISE * sigma * _MM, **_FLOOR)
    log_ticks(panels[-1].xaxis, low, high)
    panels[-1].set_xlabel("distance measured \N{MINUS SIGN} predicted [mm]")
    legend_below(
        figure,
        [Line2D([], [], label="mean", **_MEAN), Line2D([], [], label="95 % of the points", **_P95),
         Line2D([], [], label="95 % of the noise", **_FLOOR)],
    )  # fmt: skip
    caption = (
        "Distances in space, on a log axis. Noise alone would put 95 % of them left of the dashed line "
        f"({short(_NOISE * sigma * _MM)} mm at sigma {short(sigma * _MM)} mm)."
    )
    header = (
        "model", "points", "RMS [mm]", "mean [mm]", "p95 [mm]", "max [mm]", "mean + 3 sigma [mm]",
    )  # fmt: skip
    rows = tuple(
        (label, float(len(own)), *figures(own)) for label, own in zip(_MODELS, lengths, strict=True)
    )
    was, now = (short(float(np.quantile(own, 0.95)), 2) for own in lengths)
    title = f"95 % of the points were within {was} mm, now within {now} mm"
    return Picture("histogram", title, caption, figure, header, rows)


def _limits(distances: Array, sigma: float) -> tuple[float, float]:
    """Of the axis, in the unit of both. Raises ValueError where nothing is above zero."""
    least = float(np.quantile(distances, _BELOW))
    low = max(min(least, 0.3 * sigma), _DECADES * float(distances.max()), 1e-9)
    high = 1.3 * max(float(distances.max()), 3.0 * sigma)
    if not high > low:
        raise ValueError("no distance is above zero, nor is sigma")
    return low, high


def figures(distances: Array) -> tuple[Cell, ...]:
    """RMS, mean, 95th percentile, largest, and mean + 3 standard deviations (as ISO 9283 states)."""
    if not len(distances):
        return (None,) * 5
    spread = float(distances.std(ddof=1)) if len(distances) > 1 else 0.0
    mean = float(distances.mean())
    return (
        cell(np.sqrt(np.mean(distances**2))),
        cell(mean),
        cell(np.quantile(distances, 0.95)),
        cell(distances.max()),
        cell(mean + 3.0 * spread),
    )


def _mark(panel: Axes, own: Array) -> None:
    """Mean as a dotted line, the 95th percentile as a triangle on the axis."""
    panel.axvline(float(own.mean()), **_MEAN)
    panel.plot([float(np.quantile(own, 0.95))], [0.0], clip_on=False, zorder=4, **_P95)
