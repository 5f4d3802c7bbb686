"""What the types of a fleet know: from the identifications of their robots to the file of a prior."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

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
from calib.population import Key, Population, population
from calib.population.hierarchy import RobotEstimate
from studies.changes.days import known_of_record
from studies.fleet.tables import TableOutcome
from studies.identify.record import IdentifyRecord
from studies.results import read_as

_WORST = 1e6  # condition of a change of parameters
MOST = 1000
"""Robots of a type from which it is learnt: more of them change no digit that counts."""


@dataclass(frozen=True, eq=False)
class TypeEstimate:
    """A type and what its robots have in common.

    nominal : hashes of the nominal model's files; parameters : tuple of Parameter, in the prior's order
    unlike : robots whose model has other parameters; leaning : robots identified beside a type already
    """

    nominal: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    found: Population
    unlike: tuple[str, ...]
    leaning: tuple[str, ...]


def type_estimates(robots: Sequence[TableOutcome]) -> Iterator[TypeEstimate]:
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
) -> TypeEstimate | None:
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
    parameters = _parameters(same, keys)
    sizes = np.array([p.size for p in parameters])
    robots = [_robot(robot, one, B) for robot, (one, B) in counted.items()]
    unlike = tuple(robot for robot in known if robot not in counted)
    return TypeEstimate(
        nominal, parameters, population(name, keys, sizes, robots), unlike, tuple(leaning)
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


def _parameters(own: TableOutcome, keys: tuple[Key, ...]) -> tuple[Parameter, ...]:
    cell = load_cell(own.cell)
    by_key = {p.key: p for p in load_estimate(cell, _result(own)).model.parameters}
    if not by_key.keys() >= set(keys):
        raise InputError(_result(own), "estimate", "is not of its cell", "run the fleet anew")
    return tuple(by_key[key] for key in keys)
