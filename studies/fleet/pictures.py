"""Small multiples of a fleet: errors of the robots type by type, and from day to day."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from studies.fleet.record import FleetRecord, RobotTrend, SessionEntry

_LEAST = 1e-6  # mm: below it an error is drawn as none
_PANELS = 24
_ACROSS = 4
_NAMED = 12  # robots of a type that are named
_LETTERS = 20  # of names side by side
LOOKS = {
    "nominal": style.Look("nominal", style.VERMILLION, "^", "-", "", "▲"),
    "fitted": style.Look("identified", style.BLUE, "o", "-", "", "●"),
    "heldout": style.Look("held out", style.GREEN, "D", "-", "", "◆"),
}


@style.styled
def errors_by_robot(record: FleetRecord) -> style.Picture:
    """Errors of the last table of each robot, a panel a type, the worst nominal model to the right."""
    last = {own.robot: own for own in record.sessions if own.status}
    types = sorted({own.type for own in last.values()})
    groups = [_sorted([own for own in last.values() if own.type == name]) for name in types]
    figure, panels = _small(min(len(types), _PANELS))
    names: dict[Axes, list[str]] = {}
    for panel, name, group in zip(panels, types, groups, strict=False):
        at = np.arange(1, len(group) + 1)
        for key, look in LOOKS.items():
            values = _drawn([getattr(own.rms_mm, key) for own in group])
            panel.plot(at, values, **{**look.line, "linestyle": "", "markersize": 4})
        panel.set_title(style.elided(name))
        names[panel] = [own.robot for own in group]
    every = [getattr(own.rms_mm, key) for group in groups for own in group for key in LOOKS]
    keys = [key for key in LOOKS if any(getattr(own.rms_mm, key) for own in last.values())]
    _finish(figure, panels, every, "robot, least nominal error first", keys)
    for panel, own in names.items():
        if len(own) <= _NAMED:
            _name(panel, own)
    caption = (
        "RMS distance between measured and predicted points of each robot's last table, by type, in "
        "the order of the nominal model's error. A robot above its neighbours is worth a look."
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (own.type, own.robot, own.rms_mm.nominal, own.rms_mm.fitted, own.rms_mm.heldout)
        for group in groups
        for own in group
    )
    header = ("type", "robot", "nominal [mm]", "identified [mm]", "held out [mm]")
    return style.Picture(
        "errors_by_robot",
        "Error of each robot before and after identification",
        caption,
        figure,
        header,
        rows,
    )


@style.styled
def over_days(record: FleetRecord) -> style.Picture:
    """Errors of the robots that were measured again, those that changed most first."""
    trends = sorted(record.trends, key=lambda own: -abs(own.change_mm))
    shown = trends[:_PANELS]
    dated = all(own.days is not None for own in shown)
    figure, panels = _small(len(shown))
    for panel, own in zip(panels, shown, strict=True):
        at = _at(own, dated)
        panel.plot(at, _drawn(own.nominal_mm), **LOOKS["nominal"].line)
        panel.plot(at, _drawn(own.fitted_mm), **LOOKS["fitted"].line)
        panel.set_title(style.elided(own.robot))
    every = [value for own in shown for value in (*own.nominal_mm, *own.fitted_mm)]
    x = "days since the first" if dated else "table"
    _finish(figure, panels, every, x, ["nominal", "fitted"])
    left = f" Of {len(trends)} robots the {_PANELS} that changed most." * (len(trends) > _PANELS)
    caption = (
        "RMS distance between measured and predicted points from day to day: the nominal model's shows "
        f"how the robot changed, the identified one's whether its model still has the form.{left}"
    )
    rows: tuple[tuple[style.Cell, ...], ...] = tuple(
        (own.robot, table, float(at), nominal, fitted)
        for own in trends
        for table, at, nominal, fitted in zip(
            own.tables, _at(own, dated), own.nominal_mm, own.fitted_mm, strict=True
        )
    )
    header = ("robot", "table", x, "nominal [mm]", "identified [mm]")
    return style.Picture(
        "over_days",
        "Error of each robot from day to day, before and after identification",
        caption,
        figure,
        header,
        rows,
    )


def _name(panel: Axes, robots: Sequence[str]) -> None:
    """Robots by name where they are few; else their number stands."""
    labels = [style.elided(name) for name in robots]
    upright = sum(map(len, labels)) > _LETTERS
    panel.set_xticks(range(1, len(robots) + 1), labels, rotation=90 if upright else 0, fontsize=9)


def _sorted(robots: list[SessionEntry]) -> list[SessionEntry]:
    return sorted(robots, key=lambda own: (own.rms_mm.nominal or 0.0, own.robot))


def _at(own: RobotTrend, dated: bool) -> Sequence[int]:
    return own.days if dated and own.days is not None else range(1, len(own.tables) + 1)


def _drawn(values: Sequence[float | None]) -> Any:
    return np.maximum(np.array(values, dtype=float), _LEAST)


def _small(count: int) -> tuple[Figure, list[Axes]]:
    """So many panels of one scale."""
    across = min(count, _ACROSS)
    down = -(-count // across)
    figure = style.sheet(max(4.2, 1.0 + 2.3 * across), 1.4 + 2.0 * down)
    panels = figure.subplots(down, across, sharey=True, squeeze=False).ravel().tolist()
    for panel in panels[count:]:
        panel.set_axis_off()
    return figure, panels[:count]


def _finish(
    figure: Figure, panels: list[Axes], values: Sequence[float | None], x: str, keys: Sequence[str]
) -> None:
    """Give the panels one logarithmic scale and one legend."""
    from matplotlib.ticker import MaxNLocator

    known = _drawn([value for value in values if value is not None])
    low, high = float(known.min()) / 1.6, float(known.max()) * 1.6
    for number, panel in enumerate(panels):
        style.tidy(panel, "y")
        if number % _ACROSS == 0:
            panel.set_ylabel("RMS [mm]")
        if number >= len(panels) - _ACROSS:
            panel.set_xlabel(x)
        panel.set_yscale("log")
        panel.set_ylim(low, high)
        panel.xaxis.set_major_locator(MaxNLocator(4, integer=True))
        style.log_ticks(panel.yaxis, low, high)
    style.legend_below(figure, [style.key_of(LOOKS[key], linestyle="") for key in keys])
