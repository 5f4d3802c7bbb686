"""What the fit leaves: by pose and axis, against what it may depend on, over the image of a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MM = 1e3
_A_POSE = 0.14  # inch
_RING: Any = {"color": style.INK, "linestyle": "", "markerfacecolor": "none"}


@style.styled
def by_pose_and_axis(
    pose_names: Sequence[str],
    residuals: Array,
    seen: NDArray[np.bool_],
    marker_names: Sequence[str],
    sigma: float,
    outliers: NDArray[np.bool_],
    *,
    name: str = "residuals",
    title: str = "Residuals of each pose",
) -> style.Picture:
    """Residuals in x, y, z by pose with the band of the noise; three panels of equal limits.

    residuals : ndarray, shape (m, M, 3), m, measured minus predicted
    seen : ndarray of bool, shape (m, M)
    sigma : standard deviation of one coordinate [m]
    outliers : ndarray of bool, shape (m,), poses left out of the fit
    """
    flagged = outliers[:, None] & seen
    values: Array = np.array(residuals, dtype=np.float64) * _MM
    values[~seen] = np.nan
    limit = _limit(values, flagged, sigma * _MM)
    m = len(pose_names)
    figure = style.sheet(min(10.5, max(style.PANEL, _A_POSE * m)), 4.6)
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    look = style.looks(marker_names)
    for axis, panel in zip("xyz", panels, strict=True):
        style.tidy(panel, "y")
        panel.axhspan(
            -2.0 * sigma * _MM, 2.0 * sigma * _MM, color=style.FAINT, linewidth=0, zorder=0
        )
        panel.axhline(0.0, color=style.SOFT, linewidth=0.8)
        panel.set(ylabel=f"{axis} [mm]", ylim=(-limit, limit), xlim=(-0.7, m - 0.3))
        of_axis: Array = values[:, :, "xyz".index(axis)]
        for place, marker in enumerate(marker_names):
            aside = 0.55 * ((place + 0.5) / len(marker_names) - 0.5)
            at: Array = np.arange(m, dtype=np.float64) + aside
            mark: Any = {"color": look[marker].color, "marker": look[marker].marker}
            style.dots(panel, at, of_axis[:, place], markersize=4.5 if m <= 40 else 3.0, **mark)
            _flag(panel, at, of_axis[:, place], flagged[:, place], limit)
    style.pose_ticks(panels[-1], pose_names)
    panels[-1].set_xlabel("pose")
    handles = [style.key_of(look[marker], linestyle="") for marker in marker_names]
    band = f"\N{PLUS-MINUS SIGN}2 sigma, sigma = {sigma * _MM:.3g} mm"
    handles.append(style.patch_key(band, facecolor=style.FAINT))
    if flagged.any():
        handles.append(style.line_key("outlier", marker="o", markersize=9.0, **_RING))
    style.legend_below(figure, handles)
    caption = _caption(values, flagged, sigma * _MM, limit)
    header = ("pose", "RMS [mm]", "largest [mm]", "axis", "marker", "outlier")
    rows = tuple(
        _row(label, values[i], flagged[i], marker_names) for i, label in enumerate(pose_names)
    )
    title = f"{title}: {_inside(values, flagged, sigma * _MM):.0f} % are within the noise"
    return style.Picture(name, title, caption, figure, header, rows)


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


def _limit(values: Array, flagged: NDArray[np.bool_], sigma: float) -> float:
    """Half the height of the panels: what the fit holds decides, not its outliers."""
    held = np.abs(values[~flagged])
    largest = float(np.nanmax(held)) if np.isfinite(held).any() else 0.0
    return 1.12 * (max(3.0 * sigma, largest) or 1.0)


def _flag(panel: Axes, at: Array, values: Array, flagged: NDArray[np.bool_], limit: float) -> None:
    """Rings around outliers; triangles at the edge for what lies beyond it."""
    inside = flagged & (np.abs(values) <= limit)
    ring: Any = {**_RING, "clip_on": False}
    if inside.any():
        panel.plot(at[inside], values[inside], marker="o", markersize=10.0, **ring)
    for sign, arrow in ((1.0, "^"), (-1.0, "v")):
        beyond = sign * values > limit
        edge = np.full(int(beyond.sum()), sign * limit)
        if beyond.any():
            panel.plot(at[beyond], edge, marker=arrow, markersize=6.0, **ring)


def _row(
    label: str, values: Array, flagged: NDArray[np.bool_], markers: Sequence[str]
) -> tuple[style.Cell, ...]:
    """RMS over markers of the distances, and the largest coordinate with where it stands."""
    squares = (values**2).sum(axis=-1)
    known = np.isfinite(squares)
    if not known.any():
        return (label, None, None, None, None, "")
    marker, axis = np.unravel_index(np.nanargmax(np.abs(values)), values.shape)
    return (
        label,
        style.cell(np.sqrt(squares[known].mean())),
        style.cell(values[marker, axis]),
        "xyz"[axis],
        markers[int(marker)],
        "yes" if flagged.any() else "",
    )


_COLUMNS = 4
_BINS = 6
_FEWEST = 3  # poses of a bin worth a median
_FITTED = style.Look("fitted poses", style.BLUE, "o")
_HELD = style.Look("held-out poses", style.VERMILLION, "^")
_MEDIAN = style.Look("median of a sixth", style.SOFT, "_", "-")
_NOISE = style.Look("noise alone", style.INK, "", style.DASHED)


@style.styled
def against(
    error: Array,
    variables: Mapping[str, Array],
    sigma: float,
    heldout: NDArray[np.bool_],
) -> style.Picture:
    """The error of each pose over each variable, one panel a variable, with medians of sixths.

    error : ndarray, shape (m,), m, RMS over the markers of the pose
    variables : label with unit -> ndarray, shape (m,); sigma : of one coordinate [m]
    heldout : ndarray of bool, shape (m,), poses that took no part in the fit
    """
    figure, panels = style.small_panels(
        len(variables), _COLUMNS, lambda a, b: (2.6 * a + 0.4, 2.1 * b + 0.7), sharey=True
    )
    shown = error * _MM
    looks = [_FITTED, *([_HELD] if heldout.any() else [])]
    size = 4.0 if len(error) <= 100 else 2.2
    rows: list[tuple[style.Cell, ...]] = []
    for panel, (label, values) in zip(panels, variables.items(), strict=True):
        style.tidy(panel, "y")
        panel.axhline(
            np.sqrt(3.0) * sigma * _MM, color=style.INK, linewidth=1.0, linestyle=style.DASHED
        )
        for look, mask in zip(looks, (~heldout, heldout), strict=False):
            style.dots(
                panel, values[mask], shown[mask], color=look.color, marker=look.marker,
                markersize=size, markeredgewidth=0.0, alpha=0.75,
            )  # fmt: skip
        centre, median = _medians(values, shown)
        panel.plot(centre, median, color=style.SOFT, linewidth=1.6, marker="_", markersize=9.0)
        panel.set(xlabel=label, ylim=(0.0, 1.08 * float(np.nanmax(shown))))
        rows.append(
            (
                label,
                style.cell(_trend(values, shown)),
                style.cell(median.max()),
                style.cell(median.min()),
            )
        )
    for panel in panels[::_COLUMNS]:
        panel.set_ylabel("error of a pose [mm]")
    style.legend_below(figure, [style.key_of(look) for look in (*looks, _MEDIAN, _NOISE)])
    caption = (
        "RMS distance between measured and predicted markers of each pose. Where the model holds, the "
        "medians lie level near the dashed line; a slope or a bow points to what is not modelled."
    )
    header = ("against", "rank correlation [-]", "highest median [mm]", "lowest median [mm]")
    title = "The error that is left, over what it may depend on"
    return style.Picture("against", title, caption, figure, header, tuple(rows))


def _medians(values: Array, shown: Array) -> tuple[Array, Array]:
    """Medians of the error in sixths of the poses by the variable; one where it is constant."""
    order = np.argsort(values, kind="stable")
    count = max(1, min(_BINS, len(order) // _FEWEST, len(np.unique(values))))
    parts = np.array_split(order, count)
    return (
        np.array([np.median(values[part]) for part in parts]),
        np.array([np.median(shown[part]) for part in parts]),
    )


def _trend(values: Array, shown: Array) -> float:
    """Spearman's rank correlation, NaN where the variable is constant."""
    from scipy.stats import spearmanr

    if np.ptp(values) == 0.0 or np.ptp(shown) == 0.0:
        return float("nan")
    return float(spearmanr(values, shown).statistic)


_SHARE = 0.05  # of the image: the length of an arrow of the 95th percentile


@style.styled
def over_image(fields: Mapping[str, tuple[Array, Array, tuple[str, ...]]]) -> style.Picture:
    """Measured minus predicted over the image, one panel a camera, all arrows magnified alike.

    fields : camera -> where, off (n, 2), px, and the names of the readings
    """
    figure = style.sheet(min(10.5, 1.2 + 4.6 * len(fields)), 4.9)
    axes = np.atleast_1d(figure.subplots(1, len(fields), squeeze=False)[0])
    size = np.concatenate([np.linalg.norm(off, axis=1) for _, off, _ in fields.values()])
    span = max(float(np.ptp(at, axis=0).max()) for at, _, _ in fields.values()) or 1.0
    times = _SHARE * span / max(float(np.quantile(size, 0.95)), 1e-12)
    times = float(f"{times:.1g}")
    for panel, (name, (at, off, _)) in zip(axes, fields.items(), strict=True):
        _field(panel, at, off, times)
        rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
        panel.set_title(
            f"{name}: {rms:.3g} px RMS, arrows {times:g} times as long", fontsize=9, color=style.INK
        )
    axes[0].set_ylabel("v [px]")
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (name, reading, float(at[i, 0]), float(at[i, 1]), float(off[i, 0]), float(off[i, 1]))
        for name, (at, off, readings) in fields.items()
        for i, reading in enumerate(readings)
    )
    return style.Picture(
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
        *at.T, *moved.T, angles="xy", scale_units="xy", scale=1.0, color=style.BLUE, width=0.0025,
        headwidth=4.0, headlength=5.0,
    )  # fmt: skip
    panel.plot(*at.T, ".", markersize=2.0, color=style.FAINT, zorder=0)
    panel.set_aspect("equal", adjustable="datalim")
    panel.invert_yaxis()
    panel.set_xlabel("u [px]")
    panel.margins(0.08)
    style.tidy(panel)
