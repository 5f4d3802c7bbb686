"""How far each pose is off, before and after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from studies.plots.style import (
    BLUE,
    GREEN,
    INK,
    PANEL,
    VERMILLION,
    Look,
    Picture,
    cell,
    dots,
    key_of,
    legend_below,
    log_ticks,
    pose_ticks,
    sheet,
    short,
    styled,
    tidy,
)

_MM = 1e3
_A_POSE = 0.09  # inch
_LEAST = 1e-6  # mm: below it an error is drawn as none
_BEFORE = Look("before: nominal model", VERMILLION, "^", "", "", "▲")
_FITTED = Look("after: identified, fitted poses", BLUE, "o", "", "", "●")
_HELD = Look("after: identified, held-out poses", GREEN, "D", "", "", "◆")
_NOISE = Look("noise of the instrument alone", INK, "", (0, (4, 2)), "", "")  # type: ignore[arg-type]


@styled
def by_pose(
    pose_names: Sequence[str], before: Array, after: Array, heldout: NDArray[np.bool_], sigma: float
) -> Picture:
    """RMS error of each pose by the nominal and by the identified model, on one log axis.

    before, after : ndarray, shape (m,), m; heldout : ndarray of bool, shape (m,)
    sigma : of one coordinate [m]
    """
    was, now = (np.maximum(own * _MM, _LEAST) for own in (before, after))
    floor = max(np.sqrt(3.0) * sigma * _MM, _LEAST)
    at = np.arange(len(was))
    figure = sheet(min(10.5, max(PANEL, _A_POSE * len(was))), 4.0)
    panel = figure.subplots()
    tidy(panel, "y")
    panel.set_yscale("log")
    drawn = [(_BEFORE, was, np.ones_like(heldout)), (_FITTED, now, ~heldout), (_HELD, now, heldout)]
    drawn = [own for own in drawn if own[2].any()]
    for look, values, chosen in drawn:
        names = [name for name, own in zip(pose_names, chosen, strict=True) if own]
        mark = {"color": look.color, "marker": look.marker, "markersize": 5.0}
        dots(panel, names, at[chosen], values[chosen], **mark)
    panel.axhline(floor, color=INK, linewidth=1.2, linestyle=_NOISE.linestyle)
    every = np.concatenate([was, now, [floor]])
    low, high = float(every.min()) / 1.5, float(every.max()) * 1.5
    panel.set(xlabel="pose", ylabel="error of a pose, RMS [mm]", ylim=(low, high))
    log_ticks(panel.yaxis, low, high)
    pose_ticks(panel, pose_names)
    legend_below(figure, [*(key_of(look) for look, *_ in drawn), key_of(_NOISE)])
    told = heldout if heldout.any() else ~heldout
    rms = [short(float(np.sqrt(np.mean(own[told] ** 2))), 2) for own in (was, now)]
    where = "held-out" if heldout.any() else "fitted"
    caption = (
        "RMS distance between measured and predicted markers of each pose, on a log axis: by the "
        "nominal model, to which only base and markers are fitted, and by the identified one."
    )
    header = ("pose", "before [mm]", "after [mm]", "use")
    rows = tuple(
        (name, cell(a * _MM), cell(b * _MM), "held out" if held else "fitted")
        for name, a, b, held in zip(pose_names, before, after, heldout, strict=True)
    )
    title = f"Error of each pose: {rms[0]} mm before, {rms[1]} mm after (RMS at the {where} poses)"
    return Picture("errors_by_pose", title, caption, figure, header, rows)
