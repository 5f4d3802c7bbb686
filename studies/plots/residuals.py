"""What the fit leaves: residuals by pose, axis and marker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots.style import (
    FAINT,
    INK,
    PANEL,
    SOFT,
    Cell,
    Picture,
    cell,
    dots,
    key_of,
    legend_below,
    looks,
    pose_ticks,
    sheet,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MM = 1e3
_A_POSE = 0.14  # inch


@styled
def by_pose_and_axis(
    pose_names: Sequence[str],
    residuals: Array,
    seen: NDArray[np.bool_],
    marker_names: Sequence[str],
    sigma: float,
    outliers: NDArray[np.bool_] | None = None,
    *,
    name: str = "residuals",
    title: str = "Residuals of each pose",
) -> Picture:
    """Residuals in x, y, z by pose with the band of the noise; three panels of equal limits.

    residuals : ndarray, shape (m, M, 3), m, measured minus predicted
    seen : ndarray of bool, shape (m, M)
    sigma : standard deviation of one coordinate [m]
    outliers : ndarray of bool, shape (m,) or (m, M), readings left out of the fit
    """
    seen = np.asarray(seen, dtype=bool)
    flagged = _by_reading(outliers, seen)
    values: Array = np.array(residuals, dtype=np.float64) * _MM
    values[~seen] = np.nan
    limit = _limit(values, flagged, sigma * _MM)
    m = len(pose_names)
    figure = sheet(min(10.5, max(PANEL, _A_POSE * m)), 4.6)
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    look = looks(marker_names)
    for axis, panel in zip("xyz", panels, strict=True):
        tidy(panel, "y")
        panel.axhspan(-2.0 * sigma * _MM, 2.0 * sigma * _MM, color=FAINT, linewidth=0, zorder=0)
        panel.axhline(0.0, color=SOFT, linewidth=0.8)
        panel.set(ylabel=f"{axis} [mm]", ylim=(-limit, limit), xlim=(-0.7, m - 0.3))
        of_axis: Array = values[:, :, "xyz".index(axis)]
        for place, marker in enumerate(marker_names):
            aside = 0.55 * ((place + 0.5) / len(marker_names) - 0.5)
            at: Array = np.arange(m, dtype=np.float64) + aside
            mark: Any = {"color": look[marker].color, "marker": look[marker].marker}
            dots(panel, pose_names, at, of_axis[:, place], markersize=_size(m), **mark)
            _flag(panel, at, of_axis[:, place], flagged[:, place], limit)
    pose_ticks(panels[-1], pose_names)
    panels[-1].set_xlabel("pose")
    handles = [key_of(look[marker], linestyle="") for marker in marker_names]
    handles.append(_patch(f"\N{PLUS-MINUS SIGN}2 sigma, sigma = {sigma * _MM:.3g} mm"))
    if flagged.any():
        handles.append(_ring())
    legend_below(figure, handles)
    caption = _caption(values, flagged, sigma * _MM, limit)
    header = ("pose", "RMS [mm]", "largest [mm]", "axis", "marker", "outlier")
    rows = tuple(
        _row(label, values[i], flagged[i], marker_names) for i, label in enumerate(pose_names)
    )
    title = f"{title}: {_inside(values, flagged, sigma * _MM):.0f} % are within the noise"
    return Picture(name, title, caption, figure, header, rows)


def _inside(values: Array, flagged: NDArray[np.bool_], sigma: float) -> float:
    """Per cent of the coordinates in the band."""
    counted = int(np.isfinite(values[~flagged]).sum())
    inside = int((np.abs(values[~flagged]) <= 2.0 * sigma).sum())
    return 100.0 * inside / counted if counted else 0.0


def _caption(values: Array, flagged: NDArray[np.bool_], sigma: float, limit: float) -> str:
    """How many lie in the band, and what that says."""
    share = _inside(values, flagged, sigma)
    but = ", outliers not counted" if flagged.any() else ""
    edge = " Triangles at the edge stand for values beyond it."
    return (
        "Measured minus predicted coordinates of each marker. Noise alone puts 95 % of them into the "
        f"grey band; here {share:.0f} % are inside{but}. Residuals of one pose that lean to one side "
        f"point to an error of the model.{edge if (np.abs(values) > limit).any() else ''}"
    )


def _by_reading(outliers: NDArray[np.bool_] | None, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    if outliers is None:
        return np.zeros_like(seen)
    given = np.asarray(outliers, dtype=bool)
    return np.broadcast_to(given[:, None] if given.ndim == 1 else given, seen.shape) & seen


def _limit(values: Array, flagged: NDArray[np.bool_], sigma: float) -> float:
    """Half the height of the panels: what the fit holds decides, not its outliers."""
    held = np.abs(values[~flagged])
    largest = float(np.nanmax(held)) if np.isfinite(held).any() else 0.0
    return 1.12 * (max(3.0 * sigma, largest) or 1.0)


def _size(m: int) -> float:
    return 4.5 if m <= 40 else 3.0


def _flag(panel: Axes, at: Array, values: Array, flagged: NDArray[np.bool_], limit: float) -> None:
    """Rings around outliers; triangles at the edge for what lies beyond it."""
    inside = flagged & (np.abs(values) <= limit)
    ring: Any = {"color": INK, "linestyle": "", "markerfacecolor": "none", "clip_on": False}
    if inside.any():
        panel.plot(at[inside], values[inside], marker="o", markersize=10.0, **ring)
    for sign, arrow in ((1.0, "^"), (-1.0, "v")):
        beyond = sign * values > limit
        edge = np.full(int(beyond.sum()), sign * limit)
        if beyond.any():
            panel.plot(at[beyond], edge, marker=arrow, markersize=6.0, **ring)


def _patch(label: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor=FAINT, label=label)


def _ring() -> Any:
    from matplotlib.lines import Line2D

    ring: Any = {"color": INK, "linestyle": "", "markerfacecolor": "none"}
    return Line2D([], [], marker="o", markersize=9.0, label="outlier", **ring)


def _row(
    label: str, values: Array, flagged: NDArray[np.bool_], markers: Sequence[str]
) -> tuple[Cell, ...]:
    """RMS over markers of the distances, and the largest coordinate with where it stands."""
    squares = (values**2).sum(axis=-1)
    known = np.isfinite(squares)
    if not known.any():
        return (label, None, None, None, None, "")
    marker, axis = np.unravel_index(np.nanargmax(np.abs(values)), values.shape)
    return (
        label,
        cell(np.sqrt(squares[known].mean())),
        cell(values[marker, axis]),
        "xyz"[axis],
        markers[int(marker)],
        "yes" if flagged.any() else "",
    )
