"""How far poses are off, before and after, one by one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots import style

if TYPE_CHECKING:
    pass

_MM = 1e3
_A_POSE = 0.09  # inch
_LEAST = 1e-6  # mm: below it an error is drawn as none
_ROOM = 1.5  # times the least and the largest error: the ends of a log axis
_BEFORE = style.Look("before: nominal model", style.VERMILLION, "^", "", "", "▲")
_FITTED = style.Look("after: identified, fitted poses", style.BLUE, "o", "", "", "●")
_HELD = style.Look("after: identified, held-out poses", style.GREEN, "D", "", "", "◆")
_NOISE = style.Look("noise of the instrument alone", style.INK, "", style.DASHED)


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
    level = max(np.sqrt(3.0) * sigma * _MM, _LEAST)
    figure = style.sheet(min(10.5, max(style.PANEL, _A_POSE * len(pose_names))), 4.0)
    panel = figure.subplots()
    style.tidy(panel, "y")
    at = np.arange(len(pose_names))
    handles, every = [], [np.array([level])]
    for look, values in drawn:
        value = np.maximum(values, _LEAST)
        style.dots(panel, at, value, **look.mark, markersize=5.0)
        handles.append(style.key_of(look))
        every.append(value[np.isfinite(value)])
    panel.axhline(level, color=_NOISE.color, linewidth=1.2, linestyle=_NOISE.linestyle)
    known = np.concatenate(every)
    low, high = float(known.min()) / _ROOM, float(known.max()) * _ROOM
    panel.set(xlabel="pose", ylabel="error of a pose, RMS [mm]", yscale="log", ylim=(low, high))
    style.log_ticks(panel.yaxis, low, high)
    style.pose_ticks(panel, pose_names)
    style.legend_below(figure, [*handles, style.key_of(_NOISE)])
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
