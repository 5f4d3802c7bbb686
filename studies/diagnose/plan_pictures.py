"""The figures of what a plan can tell: who looks like whom, and what is found from which size on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from doe.foresight import Foresight, Sight
from studies.plots.style import (
    FAINT,
    INK,
    SOFT,
    Cell,
    Look,
    Picture,
    cell,
    key_of,
    legend_below,
    log_ticks,
    looks,
    sheet,
    styled,
    tidy,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 32  # causes on the map; the others are easier to tell and stand in the table
_HARDEST = 30.0  # times the smallest size at which the colours end
_CELL = 0.3  # inch
_COLUMNS = 4
_CURVE = np.geomspace(0.1, 4.0, 160)  # times the smallest size


def pictures(found: Foresight) -> list[Picture]:
    """The map where anything looks alike, and the power where anything can be seen."""
    return list(_pictures(found))


def _pictures(found: Foresight) -> Iterator[Picture]:
    if found.order:
        yield look_alikes(found)
    if found.seen:
        yield power(found)


# -- map of look-alikes ------------------------------------------------------------------------


@styled
def look_alikes(found: Foresight) -> Picture:
    """Map of the sizes from which on each cause (row) is told from each other (column)."""
    from matplotlib.colors import LogNorm

    shown = _hardest(found)
    names, times = [found.seen[i].key for i in shown], found.times[np.ix_(shown, shown)]
    side = _CELL * len(shown)
    figure = sheet(side + 4.6, side + 2.9, "compressed")
    panel = figure.subplots()
    panel.set_facecolor("white")
    alike = np.where(times > 1.0, np.clip(times, 1.0, _HARDEST), np.nan)
    image = panel.imshow(
        alike, cmap="Blues", norm=LogNorm(0.7, _HARDEST), interpolation="nearest", aspect="equal"
    )
    _frame(panel, names)
    _write(panel, times)
    bar = figure.colorbar(image, ax=panel, shrink=min(1.0, 3.2 / side + 0.2), aspect=25)
    bar.ax.set_ylim(1.0, _HARDEST)
    log_ticks(bar.ax.yaxis, 1.0, _HARDEST)
    bar.set_label("told apart from this many times\nthe smallest size that is found")
    bar.outline.set_visible(False)
    return Picture(
        "look_alikes",
        "Map of look-alikes",
        _map_caption(found, len(shown)),
        figure,
        ("cause", "is taken for", "rho", "told apart from [times its smallest size]"),
        tuple(_pairs(found)),
    )


def _hardest(found: Foresight) -> list[int]:
    """Causes on the map, in its order: those that are hardest to tell from another."""
    order = found.order
    if len(order) <= _MOST:
        return order
    either = np.maximum(found.times, found.times.T).max(axis=1)
    kept = set(sorted(order, key=lambda i: -either[i])[:_MOST])
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
    panel.grid(True, which="minor", color=FAINT, linewidth=0.6)
    panel.tick_params(which="minor", length=0)
    panel.spines[:].set_visible(False)
    for i in range(count):  # nothing is compared with itself
        panel.plot([i - 0.5, i + 0.5], [i - 0.5, i + 0.5], color=SOFT, linewidth=0.6)


def _write(panel: Axes, times: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    """Two digits in the cells, white on dark ones; ``=`` where no size would do."""
    for (i, j), value in np.ndenumerate(times):
        if i == j or value <= 1.0:
            continue
        text = "=" if np.isinf(value) else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"
        color = "white" if value > 5.0 else INK
        panel.text(j, i, text, ha="center", va="center", fontsize=9, color=color)


def _map_caption(found: Foresight, shown: int) -> str:
    order, twins = found.order, found.twins
    caption = (
        "Row: a cause that is there, as small as can be found. Column: what it is taken for. The "
        "number says how many times larger the cause must be to be told apart in 95 of 100 cases; "
        "= means that no size would do at these poses, an empty cell that they are told apart at once. "
        f"{len(found.seen) - len(order)} of {len(found.seen)} visible causes look like no other."
    )
    if len(order) > shown:
        caption += f" The {shown} hardest of {len(order)} are drawn; the table has all."
    if twins:
        groups = "; ".join(" and ".join(found.seen[i].key for i in group) for group in twins)
        caption += f" Twins: {groups}."
    return caption


def _pairs(found: Foresight) -> Iterator[tuple[Cell, ...]]:
    rho = None if found.alike is None else found.alike.rho
    pairs = [(i, j) for i in range(len(found.seen)) for j in found.rivals(i)]
    for i, j in sorted(pairs, key=lambda pair: -found.times[pair]):
        own = None if rho is None else float(rho[i, j])
        yield found.seen[i].key, found.seen[j].key, own, cell(found.times[i, j])


def _label(key: str) -> str:
    """``effect:where`` as people read it."""
    effect, _, where = key.partition(":")
    return f"{effect.replace('_', ' ')}, {where}"


# -- power against size ------------------------------------------------------------------------


@styled
def power(found: Foresight) -> Picture:
    """Probability that a cause is found against its size, one panel a kind of cause."""
    kinds = list(dict.fromkeys(sight.candidate.effect.kind for sight in found.seen))
    panels = {k: [s for s in found.seen if s.candidate.effect.kind == k] for k in kinds}
    joints = found.view.model.robot.joints
    look = looks([j for j in joints if any(s.candidate.where == j for s in found.seen)])
    columns = min(_COLUMNS, len(kinds))
    lines = -(-len(kinds) // columns)
    figure = sheet(3.0 * columns, 2.35 * lines + 0.5)
    axes = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for panel in axes.flat[len(kinds) :]:
        panel.remove()
    for (kind, own), panel in zip(panels.items(), axes.flat, strict=False):
        _power_panel(panel, kind, own, look)
    for row in axes:
        row[0].set_ylabel("found [%]")
    if look:
        legend_below(figure, [key_of(one, marker="", linewidth=1.8) for one in look.values()])
    caption = (
        "Probability that the diagnosis finds a cause of this size, among all that it asks, if it is "
        "the only one that the model lacks. The dashed line is nine in ten, where the smallest sizes "
        "stand; the triangle is a usual size. Of several parameters the best seen is drawn, alone."
    )
    header = (
        "cause", "parameter", "unit", "found 10 %", "found 50 %", "found 90 %", "found 99 %", "usual",
    )  # fmt: skip
    rows = tuple(_power_row(sight) for sight in found.seen)
    return Picture("detection_power", "Detection power against size", caption, figure, header, rows)


def _power_panel(panel: Axes, kind: str, own: Sequence[Sight], look: dict[str, Look]) -> None:
    tidy(panel)
    panel.set_xscale("log")
    sizes = []
    for sight in own:
        main = sight.parameters[sight.lead]
        size = sight.smallest[sight.lead] / main.scale
        sizes.append(size)
        drawn = look.get(sight.candidate.where)
        color = INK if drawn is None else drawn.color
        style = "-" if drawn is None else drawn.linestyle
        share = 100.0 * sight.found(_CURVE)
        panel.plot(size * _CURVE, share, color=color, linestyle=style, linewidth=1.8)
        if drawn is None:
            panel.annotate(
                sight.candidate.where, (size, 90.0), (-6.0, 4.0), textcoords="offset points",
                ha="right", va="bottom", fontsize=9, color=INK,
            )  # fmt: skip
        usual = main.size / main.scale
        panel.plot([usual], [0.0], marker="^", color=SOFT, markersize=6, clip_on=False, zorder=3)
    panel.axhline(90.0, color=SOFT, linewidth=0.9, linestyle=(0, (4, 3)))
    usual = own[0].parameters[own[0].lead].size / own[0].parameters[own[0].lead].scale
    low, high = 0.2 * min(sizes), 3.0 * max(sizes)
    low, high = min(low, 0.7 * usual) if usual > low / 30 else low, max(high, 1.4 * usual)
    panel.set_xlim(low, high)
    panel.set_ylim(0.0, 104.0)
    panel.set_yticks([0, 50, 90])
    log_ticks(panel.xaxis, low, high)
    panel.set_title(kind.replace("_", " "), loc="left")
    names = {s.parameters[s.lead].name for s in own}
    many = max(len(s.parameters) for s in own)
    what = names.pop() if len(names) == 1 else f"best of {many}"
    panel.set_xlabel(
        f"{what.replace('_', ' ')} [{own[0].parameters[own[0].lead].unit}]", fontsize=9
    )
    panel.tick_params(labelsize=9)


def _power_row(sight: Sight) -> tuple[Cell, ...]:
    from calib.diagnosis.power import needed_beyond

    main, size = sight.parameters[sight.lead], sight.smallest[sight.lead]
    levels = [
        np.sqrt(needed_beyond(sight.limit, sight.directions, chance) / sight.needed)
        for chance in (0.1, 0.5, 0.9, 0.99)
    ]
    sizes = [float(size * level / main.scale) for level in levels]
    return sight.key, main.name, main.unit, *sizes, main.size / main.scale
