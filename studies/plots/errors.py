"""How far poses are off: before and after, one by one and as a histogram."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MM = 1e3
_A_POSE = 0.09  # inch
_LEAST = 1e-6  # mm: below it an error is drawn as none
_ROOM = 1.5  # times the least and the largest error: the ends of a log axis
_BEFORE = style.Look("before: nominal model", style.VERMILLION, "^", "", "", "▲")
_FITTED = style.Look("after: identified, fitted poses", style.BLUE, "o", "", "", "●")
_HELD = style.Look("after: identified, held-out poses", style.GREEN, "D", "", "", "◆")
_NOISE = style.Look("noise of the instrument alone", style.INK, "", style.DASHED)
_MODELS = ("nominal model, base and markers fitted", "identified model")
_BINS_A_DECADE = 8
_BELOW = 0.005  # of the points may lie left of the axis, and count in the first bin
_DECADES = 1e-7  # shown at most, of the largest
_MEAN: Any = {"color": style.INK, "linewidth": 1.6, "linestyle": ":"}
_P95: Any = {"color": style.INK, "marker": "^", "markersize": 7.0, "linestyle": ""}
_FLOOR: Any = {"color": style.INK, "linewidth": 1.2, "linestyle": style.DASHED}
_CHI_95 = 2.795483  # 95 % of |noise| / sigma in three coordinates (chi with 3 degrees of freedom)


@style.styled
def before_and_after(
    names: Sequence[str],
    series: Iterable[tuple[style.Look, Array]],
    label: str,
    *,
    of: str = "pose",
    level: tuple[style.Look, float] | None = None,
    log: bool = False,
) -> Figure:
    """A figure of errors by pose.

    names : of the m poses, below the axis
    series : look -> ndarray, shape (m,), NaN where there is none; or shape (3, m): values, and the low
        and high ends of their intervals, thin lines
    label : of the errors with their unit; of : what the names are of
    level : a look, and where its level line stands
    log : whether on a log axis, as millimetres
    """
    figure = style.sheet(min(10.5, max(style.PANEL, _A_POSE * len(names))), 4.0)
    panel = figure.subplots()
    style.tidy(panel, "y")
    at = np.arange(len(names))
    handles, every = [], [np.zeros(0)]
    for look, values in series:
        value, *ends = np.maximum(values, _LEAST)[None] if values.ndim == 1 else values
        if ends:
            panel.vlines(at, *ends, color=look.color, linewidth=0.8, alpha=0.5)
        style.dots(panel, at, value, **look.mark, markersize=5.0)
        handles.append(style.key_of(look))
        every.append(value[np.isfinite(value)])
    if level is not None:
        look, height = level
        panel.axhline(height, color=look.color, linewidth=1.2, linestyle=look.linestyle)
        handles.append(style.key_of(look))
        every.append(np.array([height]))
    panel.set(xlabel=of, ylabel=label)
    if log:
        known = np.concatenate(every)
        low, high = float(known.min()) / _ROOM, float(known.max()) * _ROOM
        panel.set(yscale="log", ylim=(low, high))
        style.log_ticks(panel.yaxis, low, high)
    else:
        panel.set_ylim(0.0, None)
    style.pose_ticks(panel, names)
    style.legend_below(figure, handles)
    return figure


@style.styled
def by_pose(
    pose_names: Sequence[str], before: Array, after: Array, heldout: NDArray[np.bool_], sigma: float
) -> style.Picture:
    """RMS error of each pose by the nominal and by the identified model, on one log axis.

    before, after : ndarray, shape (m,), m; heldout : ndarray of bool, shape (m,)
    sigma : of one coordinate [m]
    """
    parts = (
        (_BEFORE, before, np.ones_like(heldout)), (_FITTED, after, ~heldout), (_HELD, after, heldout)
    )  # fmt: skip
    drawn = [
        (look, np.where(own, values, np.nan) * _MM) for look, values, own in parts if own.any()
    ]
    level = _NOISE, max(np.sqrt(3.0) * sigma * _MM, _LEAST)
    figure = before_and_after(pose_names, drawn, "error of a pose, RMS [mm]", level=level, log=True)
    told = heldout if heldout.any() else ~heldout
    rms = [style.short(float(np.sqrt(np.mean(own[told] ** 2))) * _MM, 2) for own in (before, after)]
    where = "held-out" if heldout.any() else "fitted"
    caption = (
        "RMS distance between measured and predicted markers of each pose, on a log axis: by the "
        "nominal model, to which only base and markers are fitted, and by the identified one."
    )
    header = ("pose", "before [mm]", "after [mm]", "use")
    rows = tuple(
        (name, style.cell(a * _MM), style.cell(b * _MM), "held out" if held else "fitted")
        for name, a, b, held in zip(pose_names, before, after, heldout, strict=True)
    )
    title = f"Error of each pose: {rms[0]} mm before, {rms[1]} mm after (RMS at the {where} poses)"
    return style.Picture("errors_by_pose", title, caption, figure, header, rows)


@style.styled
def histogram(before: Array, after: Array, sigma: float) -> style.Picture:
    """Histograms of the 3-D distances before and after, one above the other, on one log axis.

    before, after : ndarray, shape (n, 3), m, measured minus predicted; sigma : of one coordinate [m]

    Raises ValueError where neither a distance nor sigma is above zero.
    """
    lengths = [np.linalg.norm(part, axis=-1) * _MM for part in (before, after)]
    low, high = _limits(np.concatenate(lengths), sigma * _MM)
    count = max(6, round(_BINS_A_DECADE * np.log10(high / low)))
    edges = np.geomspace(low, high, count + 1)
    figure = style.sheet(style.PANEL, 4.0)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    looks: Any = ({"color": style.VERMILLION, "hatch": "//"}, {"color": style.BLUE})
    for panel, own, label, look in zip(panels, lengths, _MODELS, looks, strict=True):
        style.tidy(panel, "y")
        panel.hist(np.clip(own, low, high), edges, edgecolor="white", linewidth=0.0, **look)
        panel.set(xscale="log", xlim=(low, high), ylabel="points")
        panel.set_title(label, loc="left")
        panel.axvline(float(own.mean()), **_MEAN)
        panel.plot([float(np.quantile(own, 0.95))], [0.0], clip_on=False, zorder=4, **_P95)
        panel.axvline(_CHI_95 * sigma * _MM, **_FLOOR)
    style.log_ticks(panels[-1].xaxis, low, high)
    panels[-1].set_xlabel("distance measured \N{MINUS SIGN} predicted [mm]")
    keys = {"mean": _MEAN, "95 % of the points": _P95, "95 % of the noise": _FLOOR}
    style.legend_below(figure, [style.line_key(label, **own) for label, own in keys.items()])
    caption = (
        "Distances in space, on a log axis. Noise alone would put 95 % of them left of the dashed line "
        f"({style.short(_CHI_95 * sigma * _MM)} mm at sigma {style.short(sigma * _MM)} mm)."
    )
    header = (
        "model", "points", "RMS [mm]", "mean [mm]", "p95 [mm]", "max [mm]", "mean + 3 sigma [mm]",
    )  # fmt: skip
    rows = tuple(
        (label, float(len(own)), *figures(own)) for label, own in zip(_MODELS, lengths, strict=True)
    )
    was, now = (style.short(float(np.quantile(own, 0.95)), 2) for own in lengths)
    title = f"95 % of the points were within {was} mm, now within {now} mm"
    return style.Picture("histogram", title, caption, figure, header, rows)


def _limits(distances: Array, sigma: float) -> tuple[float, float]:
    """Of the axis, in the unit of both. Raises ValueError where nothing is above zero."""
    least = float(np.quantile(distances, _BELOW))
    low = max(min(least, 0.3 * sigma), _DECADES * float(distances.max()), 1e-9)
    high = 1.3 * max(float(distances.max()), 3.0 * sigma)
    if not high > low:
        raise ValueError("no distance is above zero, nor is sigma")
    return low, high


def figures(distances: Array) -> tuple[style.Cell, ...]:
    """RMS, mean, 95th percentile, largest, and mean + 3 standard deviations (as ISO 9283 states)."""
    if not len(distances):
        return (None,) * 5
    spread = float(distances.std(ddof=1)) if len(distances) > 1 else 0.0
    mean = float(distances.mean())
    rms, p95 = np.sqrt(np.mean(distances**2)), np.quantile(distances, 0.95)
    return tuple(map(style.cell, (rms, mean, p95, distances.max(), mean + 3.0 * spread)))
