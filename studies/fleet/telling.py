"""What a fleet says: how it stands, who is off, what a type shares, what moves from day to day."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from studies import document as doc
from studies.document import Shown, listed, mm, plural
from studies.fleet.record import (
    FleetRecord,
    OutlyingFigure,
    RobotTrend,
    SessionEntry,
    SharedEntry,
    TypeEntry,
)
from studies.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MOST = 20  # lines of a table that a terminal shows
_SURE = 0.01  # chance below which a rise or fall is said to be steady


def told(record: FleetRecord) -> doc.Document:
    """The answer, the robots one by one, and what they show together."""
    sections = (
        doc.Section("fleet", f"The fleet in {record.folder}", tuple(_robots(record))),
        doc.Section("fleet-off", "Robots that differ", tuple(_off(record))),
        doc.Section("fleet-types", "What robots of a type share", tuple(_types(record))),
        doc.Section("fleet-days", "From day to day", tuple(_days(record))),
    )
    return doc.Document(tuple(_headline(record)), tuple(own for own in sections if own.parts))


def _headline(record: FleetRecord) -> Iterator[doc.Sentence]:
    whole = len(record.sessions) - len(record.faults)
    types = listed([f"{own.type} ({own.robots})" for own in record.types], 4)
    yield doc.Sentence(
        f"{plural(whole, 'table')} of {plural(record.robots, 'robot')} done, by type: {types}."
        if whole
        else "No table could be read."
    )
    if record.faults:
        names = listed([own.robot for own in record.faults], 5)
        yield doc.Sentence(f"{plural(len(record.faults), 'table')} with faults: {names}.", "warn")
    if record.off:
        names = listed(list(dict.fromkeys(own.robot for own in record.off)), 5)
        yield doc.Sentence(f"Different from the others of their type: {names}.", "warn")
    for own in record.types:
        frequent = [_shared(own, c) for c in own.causes if 2 * c.possible > own.diagnosed > 1]
        if frequent:
            yield doc.Sentence(f"In most robots of {own.type}: {listed(frequent, 3)}.")


def _shared(own: TypeEntry, cause: SharedEntry) -> str:
    also = f", possible in {cause.possible}" if cause.possible > cause.robots else ""
    return f"{cause.key} (found in {cause.robots} of {own.diagnosed}{also})"


def _robots(record: FleetRecord) -> Iterator[doc.Part]:
    yield doc.Table(_FAULTS, record.faults, "Tables with faults", most=_MOST)
    whole = [own for own in record.sessions if own.status or own.verdict]
    asked = {"identify": _IDENTIFIED, "diagnose": _DIAGNOSED}
    day = _DAY if any(own.day for own in whole) else ()
    columns = (*_TABLE, *day, *(column for verb in record.verbs for column in asked[verb]), *_FILES)
    yield doc.Table(columns, whole, "Robots and their tables", most=_MOST)
    if any(own.pixel_mm for own in whole):
        yield doc.Sentence("Where cameras alone read, mm are those of pixels at the points.")
    if any(own.status for own in whole):
        yield doc.Figure(lambda: errors_by_robot(record), numbers=False)


_TABLE = doc.columns(SessionEntry, "robot type table")
_DAY = doc.columns(SessionEntry, "day")
_IDENTIFIED = doc.columns(
    SessionEntry, "status poses rms_mm.nominal rms_mm.fitted rms_mm.heldout sigma_mm"
)
_DIAGNOSED = doc.columns(
    SessionEntry,
    "verdict",
    doc.Column("causes", lambda row: [cause.key for cause in row.causes], doc.NAMES),
)
_FILES = doc.columns(SessionEntry, "results")
_FAULTS = doc.columns(
    SessionEntry, doc.Column("table with a fault", lambda row: row.robot), "fault"
)


def _off(record: FleetRecord) -> Iterator[doc.Part]:
    if not record.off:
        return
    yield doc.Sentence(
        "Compared with the last tables of the other robots of the type. The spread is the standard "
        "deviation of one robot more. In one type of twenty, one robot is here by chance."
    )
    yield doc.Table(_OFF, record.off, "Figures that differ", most=_MOST)


_OFF = doc.columns(OutlyingFigure, "robot type what value typical spread unit deviation limit")


def _types(record: FleetRecord) -> Iterator[doc.Part]:
    if not record.types:
        return
    asked = {"identify": _OF_ERRORS, "diagnose": _OF_VERDICTS}
    columns = (*_TYPES, *(column for verb in record.verbs for column in asked[verb]))
    yield doc.Table(columns, record.types, "Types, medians over their robots")
    rows = [
        (own.type, cause.key, cause.robots, cause.possible, own.diagnosed,
         " to ".join(map(doc.SHARE, cause.share_ci95)))
        for own in record.types for cause in own.causes
    ]  # fmt: skip
    yield doc.Table(_CAUSES, rows, "Causes by type", most=_MOST)


_TYPES = doc.columns(TypeEntry, "type robots")
_OF_ERRORS = doc.columns(TypeEntry, "rms_mm.nominal rms_mm.fitted rms_mm.heldout")
_OF_VERDICTS = doc.columns(
    TypeEntry,
    "diagnosed",
    doc.Column(
        "verdicts", lambda row: [f"{n} {verdict}" for verdict, n in row.verdicts.items()], doc.NAMES
    ),
)
_CAUSES = doc.heads(
    "type",
    "cause",
    *(Shown(title, doc.COUNT) for title in ("named in", "or possible", "of")),
    "share of such robots, 95 %",
)


def _days(record: FleetRecord) -> Iterator[doc.Part]:
    if not record.trends:
        return
    steady = [own for own in record.trends if own.p is not None and own.p < _SURE]
    if steady:
        said = listed([f"{own.robot} ({mm(own.change_mm)})" for own in steady], 5)
        yield doc.Sentence(f"The nominal model's error moves steadily in {said}.", "warn")
    rows = sorted(record.trends, key=lambda own: -abs(own.change_mm))
    yield doc.Table(_TRENDS, rows, "Robots that were measured again", most=_MOST)
    yield doc.Figure(lambda: over_days(record), numbers=False)


_TRENDS = doc.columns(
    RobotTrend,
    "robot",
    doc.Column("tables", lambda row: len(row.tables), doc.COUNT),
    doc.Column("days", lambda row: None if row.days is None else row.days[-1], doc.COUNT),
    doc.Column("nominal at first", lambda row: row.nominal_mm[0], doc.MM, "mm RMS"),
    doc.Column("at last", lambda row: row.nominal_mm[-1], doc.MM, "mm RMS"),
    "change_mm p",
)


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
    ranked = sorted(last.values(), key=lambda own: (own.rms_mm.nominal or 0.0, own.robot))
    groups = [[own for own in ranked if own.type == name] for name in types]
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
            labels = [style.elided(name) for name in own]
            turn = 90 if sum(map(len, labels)) > _LETTERS else 0
            panel.set_xticks(range(1, len(own) + 1), labels, rotation=turn, fontsize=9)
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
    title = "Error of each robot before and after identification"
    return style.Picture("errors_by_robot", title, caption, figure, header, rows)


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
    title = "Error of each robot from day to day, before and after identification"
    return style.Picture("over_days", title, caption, figure, header, rows)


def _at(own: RobotTrend, dated: bool) -> Sequence[int]:
    return own.days if dated and own.days is not None else range(1, len(own.tables) + 1)


def _drawn(values: Sequence[float | None]) -> Any:
    return np.maximum(np.array(values, dtype=float), _LEAST)


def _small(count: int) -> tuple[Figure, list[Axes]]:
    """So many panels of one scale."""
    return style.small_panels(
        count, _ACROSS, lambda a, b: (max(4.2, 1.0 + 2.3 * a), 1.4 + 2.0 * b), sharey=True
    )


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
