"""The figures of what a plan can tell: who looks like whom, and what is found from which size on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import ARM
from doe.prospect import Detectability, PowerAnalysis
from studies.plots.style import (
    FAINT,
    INK,
    SKY,
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
_FAR = 100.0  # a usual size that is farther from what is found is not drawn


def pictures(found: PowerAnalysis) -> list[Picture]:
    """The map where anything looks alike, and the power where anything can be seen."""
    return list(_pictures(found))


def _pictures(found: PowerAnalysis) -> Iterator[Picture]:
    if found.order:
        yield look_alikes(found)
    if found.seen:
        yield power(found)


# -- map of look-alikes ------------------------------------------------------------------------


@styled
def look_alikes(found: PowerAnalysis) -> Picture:
    """Map of the sizes from which on each cause (row) is told from each other (column)."""
    from matplotlib.colors import LogNorm

    shown = _hardest(found)
    names, times = [found.seen[i].key for i in shown], found.times[np.ix_(shown, shown)]
    side = _CELL * len(shown)
    figure = sheet(side + 4.6, side + 2.9, "compressed")
    panel = figure.subplots()
    panel.set_facecolor("white")
    drawn = np.zeros(found.times.shape, dtype=bool)
    drawn[tuple(np.array(found.pairs).T)] = True
    drawn = drawn[np.ix_(shown, shown)]
    alike = np.where(drawn, np.clip(times, 1.0, _HARDEST), np.nan)
    image = panel.imshow(
        alike, cmap="Blues", norm=LogNorm(0.7, _HARDEST), interpolation="nearest", aspect="equal"
    )
    _frame(panel, names)
    _write(panel, np.where(drawn, times, 0.0))
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


def _hardest(found: PowerAnalysis) -> list[int]:
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


def _write(panel: Axes, times: Array) -> None:
    """Two digits in the cells, white on dark ones, none for zero; ``=`` where no size would do."""
    for (i, j), value in np.ndenumerate(times):
        if value == 0.0:
            continue
        text = "=" if np.isinf(value) else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"
        color = "white" if value > 5.0 else INK
        panel.text(j, i, text, ha="center", va="center", fontsize=9, color=color)


def _map_caption(found: PowerAnalysis, shown: int) -> str:
    order, twins = found.order, found.confounded
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


def _pairs(found: PowerAnalysis) -> Iterator[tuple[Cell, ...]]:
    rho = None if found.alike is None else found.alike.rho
    for i, j in found.pairs:
        own = None if rho is None else float(rho[i, j])
        yield found.seen[i].key, found.seen[j].key, own, cell(found.times[i, j])


def _label(key: str) -> str:
    """``effect:where`` as people read it."""
    effect, _, where = key.partition(":")
    return f"{effect.replace('_', ' ')}, {where}"


# -- power against size ------------------------------------------------------------------------


@styled
def power(found: PowerAnalysis) -> Picture:
    """Probability that a cause is found against its size, one panel a kind of cause."""
    panels: dict[tuple[str, str], list[Detectability]] = {}
    for cause in found.seen:
        unit = cause.parameters[cause.lead].unit
        panels.setdefault((cause.candidate.effect.kind, unit), []).append(cause)
    look = _looks(found)
    columns = min(_COLUMNS, len(panels))
    lines = -(-len(panels) // columns)
    figure = sheet(3.0 * columns, 2.35 * lines + 0.5)
    axes = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for panel in axes.flat[len(panels) :]:
        panel.remove()
    for own, panel in zip(panels.values(), axes.flat, strict=False):
        _power_panel(panel, own, look)
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
    rows = tuple(_power_row(cause) for cause in found.seen)
    return Picture("detection_power", "Detection power against size", caption, figure, header, rows)


def _looks(found: PowerAnalysis) -> dict[str, Look]:
    """Of the joints, and of the arm as a whole; what acts in one place only needs none."""
    places = {cause.candidate.where for cause in found.seen}
    look = looks([j for j in found.view.model.robot.joints if j in places])
    if ARM in places:
        look[ARM] = Look(ARM, SKY, "", (0, (3, 1, 1, 1)), "", "")  # type: ignore[arg-type]
    return look


def _power_panel(panel: Axes, own: Sequence[Detectability], look: dict[str, Look]) -> None:
    """All causes of one kind whose sizes have one unit."""
    tidy(panel)
    panel.set_xscale("log")
    first = own[0].parameters[own[0].lead]
    sizes = np.array([cause.smallest[cause.lead] for cause in own]) / first.scale
    usual = np.array([cause.sizes[cause.lead] for cause in own]) / first.scale
    shown = usual[(usual > sizes.min() / _FAR) & (usual < sizes.max() * _FAR)]
    low, high = (f([*end, *between]) for f, end, between in (
        (min, [0.25 * sizes.min()], 0.7 * shown), (max, [2.5 * sizes.max()], 1.4 * shown),
    ))  # fmt: skip
    for cause, size in zip(own, sizes, strict=True):
        drawn = look.get(cause.candidate.where)
        x = np.geomspace(low, high, 240)
        panel.plot(
            x, 100.0 * cause.found(x / size), color=INK if drawn is None else drawn.color,
            linestyle="-" if drawn is None else drawn.linestyle, linewidth=1.8,
        )  # fmt: skip
    panel.plot(
        shown, np.zeros(len(shown)), linestyle="", marker="^", color=SOFT, markersize=6,
        clip_on=False, zorder=3,
    )  # fmt: skip
    panel.axhline(90.0, color=SOFT, linewidth=0.9, linestyle=(0, (4, 3)))
    panel.set_xlim(low, high)
    panel.set_ylim(0.0, 104.0)
    panel.set_yticks([0, 50, 90])
    log_ticks(panel.xaxis, low, high)
    panel.set_title(own[0].candidate.effect.kind.replace("_", " "), loc="left")
    names = {cause.parameters[cause.lead].name for cause in own}
    what = names.pop() if len(names) == 1 else "best parameter"
    panel.set_xlabel(f"{what.replace('_', ' ')} [{first.unit}]", fontsize=9)
    panel.tick_params(labelsize=9)


def _power_row(cause: Detectability) -> tuple[Cell, ...]:
    from calib.diagnosis.power import needed_beyond

    main, size = cause.parameters[cause.lead], cause.smallest[cause.lead]
    levels = [
        np.sqrt(needed_beyond(cause.limit, cause.directions, chance) / cause.needed)
        for chance in (0.1, 0.5, 0.9, 0.99)
    ]
    sizes = [float(size * level / main.scale) for level in levels]
    return cause.key, main.name, main.unit, *sizes, main.size / main.scale
