"""Who stands out of a fleet, what a type shares and knows, and what moves from day to day."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import groupby
from pathlib import Path
from statistics import median

import numpy as np

from calib import load_cell
from calib.arrays import Array
from calib.change import DayEstimate
from calib.change.difference import lasting
from calib.effects import GROUPS
from calib.effects.protocol import Parameter
from calib.errors import InputError
from calib.files.estimate import load_estimate
from calib.model.build import build, is_constant, parse_effect
from calib.model.reduction import carried_over
from calib.population import Key, population
from calib.population.hierarchy import RobotEstimate
from studies.changes.days import known_of_record
from studies.fleet.record import (
    FleetErrors,
    FleetRecord,
    OutlyingFigure,
    RobotTrend,
    SessionEntry,
    SharedEntry,
    TypeEntry,
)
from studies.fleet.tables import FleetTask, TableOutcome
from studies.identify.record import IdentifyRecord
from studies.prior import ParameterOfPrior, TypePrior
from studies.record import Envelope, InputFile
from studies.results import read_as

_FEWEST = 6
"""Robots of a type by which one of them can stand out."""
_ALARM = 0.05  # chance that anything stands out of a type where nothing is the matter
_MOST = 4
"""One robot in so many may stand out of one figure; the others are its type."""


_EQUAL = 1e-9  # of a value, below which the spread is that of the last digits


def latest(done: Sequence[TableOutcome]) -> list[TableOutcome]:
    """The last table of each robot that could be identified or diagnosed; the tables are in order."""
    last = {own.robot: own for own in done if own.status or own.verdict}
    return list(last.values())


def by_type(done: Iterable[TableOutcome]) -> dict[str, list[TableOutcome]]:
    """Tables by the name of the robot's model."""
    found: dict[str, list[TableOutcome]] = defaultdict(list)
    for own in done:
        if own.type:
            found[own.type].append(own)
    return dict(sorted(found.items()))


def off(robots: Sequence[TableOutcome]) -> list[OutlyingFigure]:
    """What stands out among robots of one type, the farthest first.

    Errors are compared by their logarithm, parameters with what their own standard deviations exceed
    the usual ones by. The limit counts everything that was asked.
    """
    figures = [*_errors(robots), *_parameters(robots)]
    asked = sum(len(values) for _, _, _, values, _ in figures)
    found = (row for figure in figures for row in _beyond(*figure, asked))
    return sorted(found, key=lambda row: -row.deviation / row.limit)


_Figure = tuple[list[TableOutcome], str, str, Array, Array]


def _errors(robots: Sequence[TableOutcome]) -> Iterator[_Figure]:
    for key in ("nominal", "fitted", "heldout"):
        known = [own for own in robots if own.rms_mm.get(key)]
        values = np.array([own.rms_mm[key] for own in known], dtype=float)
        yield known, f"{key} RMS", "mm", values, np.zeros(0)


def _parameters(robots: Sequence[TableOutcome]) -> Iterator[_Figure]:
    """Each over the robots that have it.

    Which of those that go together a model holds may differ from robot to robot: what one means then
    differs a little too, and its spread counts that.
    """
    having: dict[tuple[str, str], list[tuple[TableOutcome, int]]] = defaultdict(list)
    for own in robots:
        if own.values is not None and own.status == "converged":
            for column, parameter in enumerate(own.values.names):
                having[parameter].append((own, column))
    for (name, unit), known in having.items():
        values = np.array([own.values.value[k] for own, k in known if own.values is not None])
        std = np.array([own.values.std[k] for own, k in known if own.values is not None])
        yield [own for own, _ in known], name, unit, values, std


def _beyond(
    known: list[TableOutcome], what: str, unit: str, values: Array, std: Array, asked: int
) -> Iterator[OutlyingFigure]:
    """Who exceeds the limit; std : shape (n,), empty for errors, compared by their logarithm.

    The farthest is taken out and compared with those that are left, then the next: all up to the last
    that exceeds its limit stand out, so that two do not hide each other (Rosner's generalised ESD).
    """
    if len(values) < _FEWEST:
        return
    shown = values if len(std) else np.log(values)
    out = _standing_out(shown, asked)
    rest = np.delete(shown, out)
    typical, spread, limit = float(rest.mean()), _spread(rest), _limit(len(rest), asked)
    if spread <= _EQUAL * abs(typical):
        return
    vague = np.maximum(0.0, std**2 - np.median(std**2)) if len(std) else np.zeros(len(shown))
    for i in out:
        deviation = abs(float(shown[i]) - typical) / float(np.sqrt(spread**2 + vague[i]))
        if deviation > limit:
            yield OutlyingFigure.from_result(
                known[i],
                what=what,
                unit=unit,
                value=values[i],
                typical=typical if len(std) else np.exp(typical),
                spread=spread if len(std) else np.exp(typical) * spread,
                deviation=deviation,
                limit=limit,
            )


def _standing_out(shown: Array, asked: int) -> list[int]:
    """The farthest first; it is at one end of those that are left, in their order."""
    order = np.argsort(shown, kind="stable")
    rest, taken, last = shown[order], list[int](), 0
    while len(taken) < len(shown) // _MOST:
        middle = rest.mean()
        above = rest[-1] - middle > middle - rest[0]
        taken.append(int(order[-1] if above else order[0]))
        kept = slice(None, -1) if above else slice(1, None)
        rest, order = rest[kept], order[kept]
        if abs(shown[taken[-1]] - rest.mean()) > _limit(len(rest), asked) * _spread(rest):
            last = len(taken)
    return taken[:last]


def _spread(rest: Array) -> float:
    """Standard deviation of one more from the mean of these."""
    return float(rest.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(rest)))


@cache
def _limit(rest: int, asked: int) -> float:
    """By Student's t, in spreads; over all that was asked."""
    from scipy.stats import t

    return float(t.isf(_ALARM / (2 * asked), rest - 1))


def shared(robots: Sequence[TableOutcome]) -> list[SharedEntry]:
    """The causes named in robots of a type, the most frequent first."""
    from scipy.stats import binomtest

    diagnosed = [own for own in robots if own.verdict is not None]
    named, possible = Counter[tuple[str, str]](), Counter[str]()
    for own in diagnosed:
        named.update({(cause.effect, cause.where) for cause in own.causes})
        possible.update({key for cause in own.causes for key in cause.alike})
    rows = [
        SharedEntry(
            effect=effect,
            where=where,
            robots=count,
            possible=possible[f"{effect}:{where}"],
            share_ci95=tuple(binomtest(count, len(diagnosed)).proportion_ci(0.95, "exact")),
        )
        for (effect, where), count in named.items()
    ]
    return sorted(rows, key=lambda row: (-row.robots, -row.possible, row.effect, row.where))


def days_of(tables: Sequence[TableOutcome]) -> list[int] | None:
    """Days from a robot's first table to each, None where one has no date."""
    from datetime import date

    dates = [date.fromisoformat(own.day) for own in tables if own.day]
    return [(day - dates[0]).days for day in dates] if len(dates) == len(tables) else None


def trend_p(values: Sequence[float]) -> float | None:
    """Chance that values in any order rise or fall as steadily (Kendall), None of fewer than four."""
    from scipy.stats import kendalltau

    if len(values) < 4 or np.ptp(values) == 0.0:
        return None
    return float(kendalltau(range(len(values)), values).pvalue)


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


_WORST = 1e6  # condition of a change of parameters
MOST = 1000
"""Robots of a type from which it is learnt: more of them change no digit that counts."""


def type_priors(robots: Sequence[TableOutcome]) -> Iterator[TypePrior]:
    """What each nominal model's robots have in common, by the last table of each.

    Raises InputError where a result or a cell is gone.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[TableOutcome]] = defaultdict(list)
    for own in robots:
        if own.status in ("converged", "rank_deficient"):
            groups[own.type, own.nominal].append(own)
    for (name, nominal), members in sorted(groups.items()):
        some = np.unique(np.linspace(0, len(members) - 1, min(MOST, len(members))).astype(int))
        one = _learnt(name, nominal, [members[i] for i in some])
        if one is not None:
            yield one


def _learnt(
    name: str, nominal: tuple[str, ...], members: Sequence[TableOutcome]
) -> TypePrior | None:
    known, leaning = dict[str, DayEstimate](), list[str]()
    for own in members:
        record = read_as(_result(own), IdentifyRecord)
        if record.of_type is None:
            known[own.robot] = known_of_record(record)
        else:
            leaning.append(own.robot)
    lists = Counter(_own(one) for one in known.values())
    keys = max(lists, key=lambda own: (len(own), lists[own], own), default=())
    if not keys:
        return None
    same = next(own for own in members if own.robot in known and _own(known[own.robot]) == keys)
    terms = _terms(same, keys, lists)
    counted = {robot: (one, terms[_own(one)]) for robot, one in known.items() if _own(one) in terms}
    parameters = _of_prior(same, keys)
    sizes = np.array([p.size for p in parameters])
    robots = [_robot(robot, one, B) for robot, (one, B) in counted.items()]
    found = population(name, keys, sizes, robots)
    prior = found.prior
    entries = ParameterOfPrior.from_each(
        parameters, mean=prior.mean, spread=found.spread, std=prior.std, shrunk=prior.std / sizes
    )
    return TypePrior.from_result(
        prior,
        found,
        nominal_sha256=nominal,
        unlike=[robot for robot in known if robot not in counted],
        leaning=leaning,
        parameters=entries,
    )


def _terms(
    same: TableOutcome, keys: tuple[Key, ...], lists: Iterable[tuple[Key, ...]]
) -> dict[tuple[Key, ...], Array]:
    """How the parameters follow those of every list that is as large, (k, k); others say less.

    Cells of one robot may keep others of the constants that go together.
    """
    cell = load_cell(same.cell)
    rigid = tuple(
        e for e in cell.effects if parse_effect(e)[0] in GROUPS or is_constant(parse_effect(e)[0])
    )
    built = build(replace(cell, effects=rigid, prior=None))
    own, every = [key for key in built.model.keys if key in keys], set(built.full.keys)
    found = {}
    for theirs in lists:
        constants = [key for key in theirs if is_constant(key[0])]
        rest = [key for key in theirs if key not in constants]
        if len(theirs) != len(keys) or not set(constants) <= every or not set(rest) <= set(keys):
            continue
        T = np.zeros((len(keys), len(keys)))
        B = carried_over(built.full, built.model, constants)
        rows = [keys.index(key) for key in own]
        T[np.ix_(rows, [theirs.index(key) for key in constants])] = B
        for key in rest:
            T[keys.index(key), theirs.index(key)] = 1.0
        if np.linalg.cond(T) < _WORST:
            found[theirs] = T
    return found


def _result(own: TableOutcome) -> Path:
    (path,) = [Path(file) for file, _ in own.files if file.endswith(".identify.json")]
    return path


def _own(known: DayEstimate) -> tuple[Key, ...]:
    """Parameters of the robot itself, in an order of their own."""
    return tuple(sorted(key for key in known.keys if lasting(key)))


def _robot(name: str, known: DayEstimate, T: Array) -> RobotEstimate:
    """What a robot says, its own parameters turned by T (k, k)."""
    at = [known.keys.index(key) for key in _own(known)]
    _, V = known.ignorance()
    return RobotEstimate(
        name, T @ known.values[at], T @ known.noise()[np.ix_(at, at)] @ T.T, T @ V[at]
    )


def _of_prior(own: TableOutcome, keys: tuple[Key, ...]) -> tuple[Parameter, ...]:
    cell = load_cell(own.cell)
    by_key = {p.key: p for p in load_estimate(cell, _result(own)).model.parameters}
    if not by_key.keys() >= set(keys):
        raise InputError(_result(own), "estimate", "is not of its cell", "run the fleet anew")
    return tuple(by_key[key] for key in keys)
