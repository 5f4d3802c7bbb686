"""What a fleet says: how it stands, who is off, what a type shares, what moves from day to day."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from studies.document import (
    COUNT,
    FOUR,
    MM,
    NAMES,
    SHARE,
    TENTH,
    TEXT,
    Column,
    Document,
    Figure,
    P,
    Part,
    Section,
    Sentence,
    Table,
    listed,
    mm,
    plural,
)
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


def told(record: FleetRecord) -> Document:
    """The answer, the robots one by one, and what they show together."""
    sections = (
        Section("fleet", f"The fleet in {record.folder}", tuple(_robots(record))),
        Section("fleet-off", "Robots that differ", tuple(_off(record))),
        Section("fleet-types", "What robots of a type share", tuple(_types(record))),
        Section("fleet-days", "From day to day", tuple(_days(record))),
    )
    return Document(tuple(_headline(record)), tuple(own for own in sections if own.parts))


def _headline(record: FleetRecord) -> Iterator[Sentence]:
    whole = len(record.sessions) - len(record.faults)
    types = listed([f"{own.type} ({own.robots})" for own in record.types], 4)
    yield Sentence(
        f"{plural(whole, 'table')} of {plural(record.robots, 'robot')} done, by type: {types}."
        if whole
        else "No table could be read."
    )
    if record.faults:
        names = listed([own.robot for own in record.faults], 5)
        yield Sentence(f"{plural(len(record.faults), 'table')} with faults: {names}.", "warn")
    if record.off:
        names = listed(list(dict.fromkeys(own.robot for own in record.off)), 5)
        yield Sentence(f"Different from the others of their type: {names}.", "warn")
    for own in record.types:
        frequent = [_shared(own, c) for c in own.causes if 2 * c.possible > own.diagnosed > 1]
        if frequent:
            yield Sentence(f"In most robots of {own.type}: {listed(frequent, 3)}.")


def _shared(own: TypeEntry, cause: SharedEntry) -> str:
    also = f", possible in {cause.possible}" if cause.possible > cause.robots else ""
    return f"{cause.key} (found in {cause.robots} of {own.diagnosed}{also})"


def _robots(record: FleetRecord) -> Iterator[Part]:
    yield Table(_FAULTS, record.faults, "Tables with faults", most=_MOST)
    whole = [own for own in record.sessions if own.status or own.verdict]
    asked = {"identify": _IDENTIFIED, "diagnose": _DIAGNOSED}
    day = _DAY if any(own.day for own in whole) else ()
    columns = (*_TABLE, *day, *(column for verb in record.verbs for column in asked[verb]), *_FILES)
    yield Table(columns, whole, "Robots and their tables", most=_MOST)
    if any(own.status for own in whole):
        yield Figure(lambda: errors_by_robot(record), numbers=False)


_TABLE: tuple[Column[SessionEntry], ...] = (
    Column("robot", lambda row: row.robot),
    Column("type", lambda row: row.type),
    Column("table", lambda row: row.table, detail=True),
)
_DAY: tuple[Column[SessionEntry], ...] = (Column("day", lambda row: row.day, TEXT),)
_IDENTIFIED: tuple[Column[SessionEntry], ...] = (
    Column("status", lambda row: row.status, TEXT),
    Column("poses", lambda row: row.poses, COUNT),
    Column("nominal", lambda row: row.rms_mm.nominal, MM, "mm RMS"),
    Column("identified", lambda row: row.rms_mm.fitted, MM, "mm RMS"),
    Column("held out", lambda row: row.rms_mm.heldout, MM, "mm RMS"),
    Column("noise", lambda row: row.sigma_mm, MM, "mm", detail=True),
)
_DIAGNOSED: tuple[Column[SessionEntry], ...] = (
    Column("verdict", lambda row: row.verdict, TEXT),
    Column("causes", lambda row: [cause.key for cause in row.causes], NAMES),
)
_FILES: tuple[Column[SessionEntry], ...] = (
    Column("results", lambda row: row.results, NAMES, detail=True),
)
_FAULTS: tuple[Column[SessionEntry], ...] = (
    Column("table with a fault", lambda row: row.robot),
    Column("what is wrong", lambda row: row.fault, TEXT),
)


def _off(record: FleetRecord) -> Iterator[Part]:
    if not record.off:
        return
    yield Sentence(
        "Compared with the last tables of the other robots of the type. The spread is the standard "
        "deviation of one robot more. In one type of twenty, one robot is here by chance."
    )
    yield Table(_OFF, record.off, "Figures that differ", most=_MOST)


_OFF: tuple[Column[OffEntry], ...] = (
    Column("robot", lambda row: row.robot),
    Column("type", lambda row: row.type),
    Column("figure", lambda row: row.what),
    Column("value", lambda row: row.value, FOUR),
    Column("typical", lambda row: row.typical, FOUR),
    Column("spread", lambda row: row.spread, FOUR),
    Column("unit", lambda row: row.unit),
    Column("off by", lambda row: row.deviation, TENTH, "spreads"),
    Column("limit", lambda row: row.limit, TENTH, "spreads"),
)


@dataclass(frozen=True)
class _OfType:
    """A cause in a type."""

    type: TypeEntry
    cause: SharedEntry

    @property
    def between(self) -> str:
        low, high = self.cause.share_ci95
        return f"{SHARE(low)} to {SHARE(high)}"


def _types(record: FleetRecord) -> Iterator[Part]:
    if not record.types:
        return
    asked = {"identify": _OF_ERRORS, "diagnose": _OF_VERDICTS}
    columns = (*_TYPES, *(column for verb in record.verbs for column in asked[verb]))
    yield Table(columns, record.types, "Types, medians over their robots")
    rows = [_OfType(own, cause) for own in record.types for cause in own.causes]
    yield Table(_CAUSES, rows, "Causes by type", most=_MOST)


_TYPES: tuple[Column[TypeEntry], ...] = (
    Column("type", lambda row: row.type),
    Column("robots", lambda row: row.robots, COUNT),
)
_OF_ERRORS: tuple[Column[TypeEntry], ...] = (
    Column("nominal", lambda row: row.rms_mm.nominal, MM, "mm RMS"),
    Column("identified", lambda row: row.rms_mm.fitted, MM, "mm RMS"),
    Column("held out", lambda row: row.rms_mm.heldout, MM, "mm RMS"),
)
_OF_VERDICTS: tuple[Column[TypeEntry], ...] = (
    Column("diagnosed", lambda row: row.diagnosed, COUNT),
    Column(
        "verdicts", lambda row: [f"{n} {verdict}" for verdict, n in row.verdicts.items()], NAMES
    ),
)
_CAUSES: tuple[Column[_OfType], ...] = (
    Column("type", lambda row: row.type.type),
    Column("cause", lambda row: row.cause.key),
    Column("named in", lambda row: row.cause.robots, COUNT),
    Column("or possible", lambda row: row.cause.possible, COUNT),
    Column("of", lambda row: row.type.diagnosed, COUNT),
    Column("share of such robots, 95 %", lambda row: row.between),
)


def _days(record: FleetRecord) -> Iterator[Part]:
    if not record.trends:
        return
    steady = [own for own in record.trends if own.p is not None and own.p < _SURE]
    if steady:
        said = listed([f"{own.robot} ({mm(own.change_mm)})" for own in steady], 5)
        yield Sentence(f"The nominal model's error moves steadily in {said}.", "warn")
    rows = sorted(record.trends, key=lambda own: -abs(own.change_mm))
    yield Table(_TRENDS, rows, "Robots that were measured again", most=_MOST)
    yield Figure(lambda: over_days(record), numbers=False)


_TRENDS: tuple[Column[RobotTrend], ...] = (
    Column("robot", lambda row: row.robot),
    Column("tables", lambda row: len(row.tables), COUNT),
    Column("days", lambda row: None if row.days is None else row.days[-1], COUNT),
    Column("nominal at first", lambda row: row.nominal_mm[0], MM, "mm RMS"),
    Column("at last", lambda row: row.nominal_mm[-1], MM, "mm RMS"),
    Column("change", lambda row: row.change_mm, MM, "mm"),
    Column("p of a trend", lambda row: row.p, P),
)
