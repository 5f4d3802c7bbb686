"""From the tables of a fleet to the record of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from statistics import median

from studies.fleet.record import FleetErrors, FleetRecord, RobotTrend, SessionEntry, TypeEntry
from studies.fleet.spread import by_type, days_of, latest, off, shared, trend_p
from studies.fleet.tables import FleetTask, TableOutcome
from studies.record import Envelope, InputFile


def fleet_record(
    done: Sequence[TableOutcome], folder: str, asked: FleetTask, made_from: Envelope
) -> FleetRecord:
    """The record of a fleet, its tables in any order."""
    ordered = _ordered(done)
    groups = by_type(latest(ordered))
    return FleetRecord(
        **made_from,
        folder=folder,
        verbs=asked.verbs,
        holdout=asked.holdout,
        sessions=SessionEntry.from_each(
            ordered, results=[[file for file, _ in own.files] for own in ordered]
        ),
        types=tuple(_type(name, robots) for name, robots in groups.items()),
        off=tuple(row for own in groups.values() for row in off(own)),
        trends=tuple(_trends(ordered)),
    )


def results_of(done: Sequence[TableOutcome]) -> tuple[InputFile, ...]:
    """What a fleet's record is made from."""
    return tuple(InputFile(file=f, sha256=h) for own in _ordered(done) for f, h in own.files)


def _ordered(done: Sequence[TableOutcome]) -> list[TableOutcome]:
    """By robot, the tables of each by day where all have one, else by name."""
    dated = {own.robot: True for own in done}
    for own in done:
        dated[own.robot] &= own.day is not None
    return sorted(done, key=lambda own: (own.robot, own.day if dated[own.robot] else "", own.table))


def _type(name: str, robots: Sequence[TableOutcome]) -> TypeEntry:
    verdicts = [own.verdict for own in robots if own.verdict is not None]
    known = {key: _known(robots, key) for key in FleetErrors.model_fields}
    return TypeEntry.from_result(
        type=name,
        robots=len(robots),
        diagnosed=len(verdicts),
        rms_mm=FleetErrors(**{key: median(own) if own else None for key, own in known.items()}),
        verdicts={verdict: verdicts.count(verdict) for verdict in sorted({*verdicts})},
        causes=shared(robots),
    )


def _known(robots: Sequence[TableOutcome], key: str) -> list[float]:
    return [value for own in robots if (value := own.rms_mm.get(key)) is not None]


def _trends(done: Sequence[TableOutcome]) -> Iterator[RobotTrend]:
    """Of robots with several tables that could be identified."""
    for robot, own_tables in groupby(done, lambda own: own.robot):
        tables = [own for own in own_tables if own.status]
        if len(tables) < 2:
            continue
        nominal, days = _known(tables, "nominal"), days_of(tables)
        yield RobotTrend(
            robot=robot,
            type=tables[-1].type,
            tables=tuple(own.table for own in tables),
            days=None if days is None else tuple(days),
            nominal_mm=tuple(nominal),
            fitted_mm=tuple(_known(tables, "fitted")),
            p=trend_p(nominal),
        )
