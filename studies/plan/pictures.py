"""The figures of what a plan can tell: who looks like whom, and what is found from which size on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.arrays import Array
from calib.effects.context import ARM
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from studies.plan.record import PlanRecord, SeenCause

_MOST = 32  # causes on the map; the others are easier to tell and stand in the table
_HARDEST = 30.0  # times the smallest size at which the colours end
_CELL = 0.26  # inch
_COLUMNS = 4
_NINE = style.Look("found nine times in ten", style.SOFT, "", (0, (4, 3)))
_USUAL = style.Look("usual size", style.SOFT, "^", "", "", "")
_FAR = 100.0  # a usual size that is farther from what is found is not drawn


# -- map of look-alikes ------------------------------------------------------------------------


@style.styled
def look_alikes(record: PlanRecord) -> style.Picture:
    """Map of the sizes from which on each cause (row) is told from each other (column)."""
    from matplotlib.colors import LogNorm

    members, times = _times(record)
    shown = _hardest(times)
    names, times = [members[i] for i in shown], times[np.ix_(shown, shown)]
    side = _CELL * len(shown)
    figure = style.sheet(side + 4.6, side + 2.9, "compressed")
    panel = figure.subplots()
    panel.set_facecolor("white")
    alike = np.where(times > 0.0, np.clip(times, 1.0, _HARDEST), np.nan)
    image = panel.imshow(
        alike, cmap="Blues", norm=LogNorm(0.7, _HARDEST), interpolation="nearest", aspect="equal"
    )
    _frame(panel, names)
    _write(panel, times)
    bar = figure.colorbar(image, ax=panel, shrink=min(1.0, 3.2 / side + 0.2), aspect=25)
    bar.ax.set_ylim(1.0, _HARDEST)
    style.log_ticks(bar.ax.yaxis, 1.0, _HARDEST)
    bar.set_label("told apart from\nthis many times\nthe smallest size\nthat is found")
    bar.outline.set_visible(False)
    return style.Picture(
        "look_alikes",
        "Causes that look alike at these poses, and from which size on they do not",
        _map_caption(record, len(members), len(shown)),
        figure,
        ("cause", "is taken for", "rho", "told apart from [times its smallest size]"),
        tuple((p.key, p.like.key, p.rho, p.told_apart_times) for p in record.look_alikes),
    )


def _times(record: PlanRecord) -> tuple[list[str], Array]:
    """Causes with look-alikes, and the size from which on each is told from each; zero at once."""
    pairs, keys = record.look_alikes, [cause.key for cause in record.seen]
    either = {pair.key for pair in pairs} | {pair.like.key for pair in pairs}
    members = [key for key in keys if key in either]
    times = np.zeros((len(members), len(members)))
    for pair in pairs:
        told = pair.told_apart_times
        times[members.index(pair.key), members.index(pair.like.key)] = told or np.inf
    return members, times


def _hardest(times: Array) -> list[int]:
    """Causes on the map: those that are hardest to tell, each beside those that it is taken for."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    either = np.maximum(times, times.T)
    distance = 1.0 / np.maximum(either, 1.0)
    np.fill_diagonal(distance, 0.0)
    tree = linkage(squareform(distance), method="average", optimal_ordering=True)
    order = [int(i) for i in leaves_list(tree)]
    kept = sorted(order, key=lambda i: -either[i].max())[:_MOST]
    return [i for i in order if i in kept]


def _frame(panel: Axes, names: Sequence[str]) -> None:
    count = len(names)
    labels = [_label(name) for name in names]
    panel.set_yticks(range(count), labels, fontsize=9)
    panel.set_xticks(range(count), labels, fontsize=9, rotation=90)
    panel.tick_params(length=0)
    panel.set_ylabel("the cause that is there")
    panel.set_xlabel("what it is taken for")
    panel.set_xticks(np.arange(count + 1) - 0.5, minor=True)
    panel.set_yticks(np.arange(count + 1) - 0.5, minor=True)
    panel.grid(True, which="minor", color=style.FAINT, linewidth=0.6)
    panel.tick_params(which="minor", length=0)
    panel.spines[:].set_visible(False)
    for i in range(count):  # nothing is compared with itself
        panel.plot([i - 0.5, i + 0.5], [i - 0.5, i + 0.5], color=style.SOFT, linewidth=0.6)


def _write(panel: Axes, times: Array) -> None:
    """Two digits in the cells, white on dark ones, none for zero; ``=`` where no size would do."""
    for (i, j), value in np.ndenumerate(times):
        if value == 0.0:
            continue
        text = "=" if np.isinf(value) else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"
        color = style.ON_DARK if value > 5.0 else style.ON_LIGHT
        panel.text(j, i, text, ha="center", va="center", fontsize=9, color=color)


def _map_caption(record: PlanRecord, members: int, shown: int) -> str:
    seen = len(record.seen)
    caption = (
        "Row: a cause that is there, as small as can be found. Column: what it is taken for. The "
        "number says how many times larger the cause must be to be told apart in 95 of 100 cases; "
        "= means that no size would do at these poses, an empty cell that they are told apart at once. "
        f"{seen - members} of {seen} visible causes look like no other."
    )
    if members > shown:
        caption += f" The {shown} hardest of {members} are drawn; the table has all."
    if record.twins:
        groups = "; ".join(" and ".join(m.key for m in twins.members) for twins in record.twins)
        caption += f" Equivalent: {groups}."
    return caption


def _label(key: str) -> str:
    """``effect:where`` as people read it."""
    effect, _, where = key.partition(":")
    return f"{effect.replace('_', ' ')}, {where}"


# -- power against size ------------------------------------------------------------------------


@style.styled
def power(record: PlanRecord) -> style.Picture:
    """Probability that a cause is found against its size, one panel a kind of cause."""
    panels: dict[tuple[str, str], list[SeenCause]] = {}
    for cause in record.seen:
        panels.setdefault((cause.effect, cause.unit), []).append(cause)
    look = _looks(record)
    columns = min(_COLUMNS, len(panels))
    lines = -(-len(panels) // columns)
    figure = style.sheet(3.0 * columns, 2.35 * lines + 0.5)
    axes = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for panel in axes.flat[len(panels) :]:
        panel.remove()
    for own, panel in zip(panels.values(), axes.flat, strict=False):
        _power_panel(panel, own, look, record.power)
    for row in axes:
        row[0].set_ylabel("found [%]")
    handles = [style.key_of(one, marker="", linewidth=1.8) for one in look.values()]
    handles += [style.key_of(one, linewidth=0.9) for one in (_NINE, _USUAL)]
    style.legend_below(figure, handles)
    caption = (
        "Probability that the diagnosis finds a cause of this size, among all that it asks, if it is "
        "the only one that the model lacks. The dashed line is nine in ten, where the smallest sizes "
        "stand; the triangle is a usual size. Of several parameters the best seen is drawn, alone."
    )
    header = (
        "cause", "parameter", "unit", "found 10 %", "found 50 %", "found 90 %", "found 99 %", "usual",
    )  # fmt: skip
    rows = tuple(_power_row(cause, record.power) for cause in record.seen)
    title = "From which size on each cause is found"
    return style.Picture("detection_power", title, caption, figure, header, rows)


def _looks(record: PlanRecord) -> dict[str, style.Look]:
    """Of the joints, and of the arm as a whole; what acts in one place only needs none."""
    places = {cause.where for cause in record.seen}
    look = style.looks([joint for joint in record.joints if joint in places])
    if ARM in places:
        look[ARM] = style.Look(ARM, style.SKY, "", (0, (3, 1, 1, 1)))
    return look


def _power_panel(
    panel: Axes, own: Sequence[SeenCause], look: dict[str, style.Look], power: float
) -> None:
    """All causes of one kind whose sizes have one unit."""
    from scipy.special import chndtr

    style.tidy(panel)
    panel.set_xscale("log")
    sizes = np.array([cause.size for cause in own])
    usual = np.array([cause.plausible for cause in own])
    shown = usual[(usual > sizes.min() / _FAR) & (usual < sizes.max() * _FAR)]
    low, high = (f([*end, *between]) for f, end, between in (
        (min, [0.25 * sizes.min()], 0.7 * shown), (max, [2.5 * sizes.max()], 1.4 * shown),
    ))  # fmt: skip
    x = np.geomspace(low, high, 240)
    for cause in own:
        drawn, limit = look.get(cause.where), _limit(cause, power)
        there = (cause.noncentrality or 0.0) * (x / cause.size) ** 2
        panel.plot(
            x, 100.0 * (1.0 - chndtr(limit, cause.directions, there)), linewidth=1.8,
            color=style.INK if drawn is None else drawn.color,
            linestyle="-" if drawn is None else drawn.linestyle,
        )  # fmt: skip
    panel.plot(shown, np.zeros(len(shown)), **_USUAL.line, markersize=6, clip_on=False, zorder=3)
    panel.axhline(90.0, color=_NINE.color, linewidth=0.9, linestyle=_NINE.linestyle)
    panel.set_xlim(low, high)
    panel.set_ylim(0.0, 104.0)
    panel.set_yticks([0, 50, 90])
    style.log_ticks(panel.xaxis, low, high)
    panel.set_title(own[0].effect.replace("_", " "), loc="left")
    names = {cause.parameter for cause in own}
    what = names.pop() if len(names) == 1 else "best parameter"
    panel.set_xlabel(f"{what.replace('_', ' ')} [{own[0].unit}]", fontsize=9)
    panel.tick_params(labelsize=9)


def _limit(cause: SeenCause, power: float) -> float:
    """The score beyond which a cause is believed: its smallest size is found with this power."""
    from scipy.special import chndtrix

    return float(chndtrix(1.0 - power, cause.directions, cause.noncentrality))


def _power_row(cause: SeenCause, power: float) -> tuple[style.Cell, ...]:
    from scipy.special import chndtrinc

    limit, needed = _limit(cause, power), cause.noncentrality or 1.0
    sizes = [
        style.cell(
            cause.size * (float(chndtrinc(limit, cause.directions, 1.0 - chance)) / needed) ** 0.5
        )
        for chance in (0.1, 0.5, 0.9, 0.99)
    ]
    return cause.key, cause.parameter, cause.unit, *sizes, cause.plausible
