"""By how much each parameter moved, and what that does at each target."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.plots import style
from studies.plots.errors import before_and_after
from studies.record import intervals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from studies.changes.record import ChangesRecord

_NARROWEST = 3.0  # standard deviations to either side
_MOVED = style.Look("the robot itself moved", style.BLUE, "o", "", "", "●")
_TOLERANCE = style.Look("tolerance", style.INK, "", "-.", "", "")
_LINEAR = 5.0  # standard deviations; beyond, the scale is logarithmic


@style.styled
def changed_parameters(record: ChangesRecord) -> style.Picture:
    """Each difference in its standard deviations, those that surely moved apart."""
    known = [p for p in record.parameters if p.std]
    ratio = np.array([p.change / p.std for p in known if p.std])
    at, moved = np.arange(len(known)), np.array([p.moved for p in known], dtype=bool)
    figure = style.sheet(style.PANEL, max(2.4, 1.2 + 0.19 * len(known)))
    panel = figure.subplots()
    style.tidy(panel, "x")
    band = panel.axvspan(-2.0, 2.0, color=style.FAINT, linewidth=0, zorder=0)
    band.set_label("two standard deviations")
    panel.axvline(0.0, color=style.SOFT, linewidth=0.8)
    handles: list[Any] = []
    for chosen, color, mark, label in (
        (~moved, style.BLUE, "o", "not moved for sure"), (moved, style.VERMILLION, "^", "moved")
    ):  # fmt: skip
        if chosen.any():
            handles += panel.plot(ratio[chosen], at[chosen], color=color, marker=mark, linestyle="",
                                  label=label)  # fmt: skip
    handles.append(band)
    panel.set_xscale("symlog", linthresh=_LINEAR)
    reach = max(1.15 * float(np.abs(ratio).max(initial=0.0)), _NARROWEST)
    panel.set_xlim(-reach, reach)
    _plain_ticks(panel)
    panel.set_yticks(at, style.brief([p.id for p in known]), fontsize=9)
    panel.set(xlabel="after - before [standard deviations]", ylim=(len(known) - 0.4, -0.6))
    style.legend_below(figure, handles)
    caption = (
        "By how much each parameter differs between the two results, in standard deviations of the "
        "difference; the band is two of them, the scale logarithmic beyond five. Parameters are "
        "correlated: what moved is told by all of them together."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (p.id, p.change, p.std, p.unit, p.family_p, "moved" if p.moved else "") for p in known
    )
    header = ("parameter", "after - before", "standard deviation", "unit", "p over all", "")
    title = (
        f"{int(moved.sum()) or 'No'} of {len(known)} parameters moved for sure: after minus before"
    )
    return style.Picture("changed_parameters", title, caption, figure, header, rows)


def _plain_ticks(panel: Axes) -> None:
    """Numbers at zero, where the scale turns logarithmic, and at a few powers of ten beyond.

    At each step of one or two where it does not.
    """
    low, high = panel.get_xlim()
    if high <= _LINEAR:
        panel.set_xticks(np.arange(-4.0, 5.0, 2.0 if high > _NARROWEST else 1.0))
        panel.set_xlim(low, high)
    else:
        decades = math.floor(math.log10(max(-low, high, _LINEAR)))
        far = [10.0**k for k in range(decades, 1 if decades > 1 else 0, -max(1, decades // 3))]
        far.append(_LINEAR)  # ten is too near to it where there is more
        ticks = [0.0, *far, *(-tick for tick in far)]
        panel.set_xticks([tick for tick in ticks if low <= tick <= high])
    panel.xaxis.set_major_formatter("{x:g}")
    panel.minorticks_off()


def errors_at_targets(record: ChangesRecord) -> style.Picture:
    """The error at each target with the earlier values, and what the robot itself moved by."""
    targets = sorted(record.at_targets, key=lambda target: -target.kept_mm.value)
    off = style.Look(f"off today with {record.before}", style.VERMILLION, "^", "", "", "▲")
    series = [(off, [t.kept_mm for t in targets]), (_MOVED, [t.change_mm for t in targets])]
    figure = before_and_after(
        [target.pose for target in targets],
        [(look, intervals(errors)) for look, errors in series],
        "error at the target [mm]",
        of="target, the worst first",
        level=None if record.tolerance_mm is None else (_TOLERANCE, record.tolerance_mm),
    )
    caption = (
        "By how much each target is missed on the later day with the earlier calibration, and how far "
        "the robot itself moved there between the days, with 95 % intervals."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (t.pose, t.kept_mm.value, t.kept_mm.low, t.kept_mm.high, t.change_mm.value,
         t.change_mm.low, t.change_mm.high)
        for t in targets
    )  # fmt: skip
    header = ("target", "kept [mm]", "from [mm]", "to [mm]", "moved [mm]", "from [mm]", "to [mm]")
    return style.Picture(
        "changes_at_targets",
        f"Error at each target today, with {record.before} and by the robot itself",
        caption,
        figure,
        header,
        rows,
    )
