"""What a fleet says: how it stands, who is off, what a type shares, what moves from day to day."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from studies import document as doc
from studies.document import listed, mm, plural
from studies.fleet.pictures import errors_by_robot, over_days
from studies.fleet.record import (
    FleetRecord,
    OffEntry,
    RobotTrend,
    SessionEntry,
    SharedEntry,
    TypeEntry,
)

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
    if any(own.status for own in whole):
        yield doc.Figure(lambda: errors_by_robot(record), numbers=False)


_TABLE: tuple[doc.Column[SessionEntry], ...] = (
    doc.Column("robot", lambda row: row.robot),
    doc.Column("type", lambda row: row.type),
    doc.Column("table", lambda row: row.table, detail=True),
)
_DAY: tuple[doc.Column[SessionEntry], ...] = (doc.Column("day", lambda row: row.day, doc.TEXT),)
_IDENTIFIED: tuple[doc.Column[SessionEntry], ...] = (
    doc.Column("status", lambda row: row.status, doc.TEXT),
    doc.Column("poses", lambda row: row.poses, doc.COUNT),
    doc.Column("nominal", lambda row: row.rms_mm.nominal, doc.MM, "mm RMS"),
    doc.Column("identified", lambda row: row.rms_mm.fitted, doc.MM, "mm RMS"),
    doc.Column("held out", lambda row: row.rms_mm.heldout, doc.MM, "mm RMS"),
    doc.Column("noise", lambda row: row.sigma_mm, doc.MM, "mm", detail=True),
)
_DIAGNOSED: tuple[doc.Column[SessionEntry], ...] = (
    doc.Column("verdict", lambda row: row.verdict, doc.TEXT),
    doc.Column("causes", lambda row: [cause.key for cause in row.causes], doc.NAMES),
)
_FILES: tuple[doc.Column[SessionEntry], ...] = (
    doc.Column("results", lambda row: row.results, doc.NAMES, detail=True),
)
_FAULTS: tuple[doc.Column[SessionEntry], ...] = (
    doc.Column("table with a fault", lambda row: row.robot),
    doc.Column("what is wrong", lambda row: row.fault, doc.TEXT),
)


def _off(record: FleetRecord) -> Iterator[doc.Part]:
    if not record.off:
        return
    yield doc.Sentence(
        "Compared with the last tables of the other robots of the type. The spread is the standard "
        "deviation of one robot more. In one type of twenty, one robot is here by chance."
    )
    yield doc.Table(_OFF, record.off, "Figures that differ", most=_MOST)


_OFF: tuple[doc.Column[OffEntry], ...] = (
    doc.Column("robot", lambda row: row.robot),
    doc.Column("type", lambda row: row.type),
    doc.Column("figure", lambda row: row.what),
    doc.Column("value", lambda row: row.value, doc.FOUR),
    doc.Column("typical", lambda row: row.typical, doc.FOUR),
    doc.Column("spread", lambda row: row.spread, doc.FOUR),
    doc.Column("unit", lambda row: row.unit),
    doc.Column("off by", lambda row: row.deviation, doc.TENTH, "spreads"),
    doc.Column("limit", lambda row: row.limit, doc.TENTH, "spreads"),
)


@dataclass(frozen=True)
class _OfType:
    """A cause in a type."""

    type: TypeEntry
    cause: SharedEntry

    @property
    def between(self) -> str:
        low, high = self.cause.share_ci95
        return f"{doc.SHARE(low)} to {doc.SHARE(high)}"


def _types(record: FleetRecord) -> Iterator[doc.Part]:
    if not record.types:
        return
    asked = {"identify": _OF_ERRORS, "diagnose": _OF_VERDICTS}
    columns = (*_TYPES, *(column for verb in record.verbs for column in asked[verb]))
    yield doc.Table(columns, record.types, "Types, medians over their robots")
    rows = [_OfType(own, cause) for own in record.types for cause in own.causes]
    yield doc.Table(_CAUSES, rows, "Causes by type", most=_MOST)


_TYPES: tuple[doc.Column[TypeEntry], ...] = (
    doc.Column("type", lambda row: row.type),
    doc.Column("robots", lambda row: row.robots, doc.COUNT),
)
_OF_ERRORS: tuple[doc.Column[TypeEntry], ...] = (
    doc.Column("nominal", lambda row: row.rms_mm.nominal, doc.MM, "mm RMS"),
    doc.Column("identified", lambda row: row.rms_mm.fitted, doc.MM, "mm RMS"),
    doc.Column("held out", lambda row: row.rms_mm.heldout, doc.MM, "mm RMS"),
)
_OF_VERDICTS: tuple[doc.Column[TypeEntry], ...] = (
    doc.Column("diagnosed", lambda row: row.diagnosed, doc.COUNT),
    doc.Column(
        "verdicts", lambda row: [f"{n} {verdict}" for verdict, n in row.verdicts.items()], doc.NAMES
    ),
)
_CAUSES: tuple[doc.Column[_OfType], ...] = (
    doc.Column("type", lambda row: row.type.type),
    doc.Column("cause", lambda row: row.cause.key),
    doc.Column("named in", lambda row: row.cause.robots, doc.COUNT),
    doc.Column("or possible", lambda row: row.cause.possible, doc.COUNT),
    doc.Column("of", lambda row: row.type.diagnosed, doc.COUNT),
    doc.Column("share of such robots, 95 %", lambda row: row.between),
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


_TRENDS: tuple[doc.Column[RobotTrend], ...] = (
    doc.Column("robot", lambda row: row.robot),
    doc.Column("tables", lambda row: len(row.tables), doc.COUNT),
    doc.Column("days", lambda row: None if row.days is None else row.days[-1], doc.COUNT),
    doc.Column("nominal at first", lambda row: row.nominal_mm[0], doc.MM, "mm RMS"),
    doc.Column("at last", lambda row: row.nominal_mm[-1], doc.MM, "mm RMS"),
    doc.Column("change", lambda row: row.change_mm, doc.MM, "mm"),
    doc.Column("p of a trend", lambda row: row.p, doc.P),
)
