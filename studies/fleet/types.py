"""What the types of a fleet know: from the identifications of their robots to the file of a prior."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib import load_cell
from calib.change import Known
from calib.change.difference import lasting
from calib.effects.protocol import Parameter
from calib.errors import InputError
from calib.files.estimate import load_estimate
from calib.population import Key, Population, population
from calib.population.hierarchy import Robot
from studies.changes.days import known_of_record
from studies.fleet.one import Done
from studies.identify.record import IdentifyRecord
from studies.record import read_as

MOST = 1000
"""Robots of a type from which it is learnt: more of them change no digit that counts."""


@dataclass(frozen=True, eq=False)
class Learnt:
    """A type and what its robots have in common.

    nominal : hashes of the nominal model's files; parameters : tuple of Parameter, in the prior's order
    unlike : robots whose model has other parameters; leaning : robots identified beside a type already
    """

    nominal: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    found: Population
    unlike: tuple[str, ...]
    leaning: tuple[str, ...]


def learnt(robots: Sequence[Done]) -> Iterator[Learnt]:
    """What each nominal model's robots have in common, by the last table of each.

    Raises InputError where a result or a cell is gone.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[Done]] = defaultdict(list)
    for own in robots:
        if own.status in ("converged", "rank_deficient"):
            groups[own.type, own.nominal].append(own)
    for (name, nominal), members in sorted(groups.items()):
        some = np.unique(np.linspace(0, len(members) - 1, min(MOST, len(members))).astype(int))
        one = _learnt(name, nominal, [members[i] for i in some])
        if one is not None:
            yield one


def _learnt(name: str, nominal: tuple[str, ...], members: Sequence[Done]) -> Learnt | None:
    known, leaning = dict[str, Known](), list[str]()
    for own in members:
        record = read_as(_result(own), IdentifyRecord)
        if record.of_type is None:
            known[own.robot] = known_of_record(record)
        else:
            leaning.append(own.robot)
    lists = Counter(_own(one) for one in known.values())
    if not lists:
        return None
    keys, _ = max(lists.items(), key=lambda entry: (entry[1], len(entry[0])))
    if not keys:
        return None
    alike = [own for own in members if own.robot in known and _own(known[own.robot]) == keys]
    parameters = _parameters(alike[0], keys)
    sizes = np.array([p.size for p in parameters])
    found = population(name, keys, sizes, [_robot(o.robot, known[o.robot], keys) for o in alike])
    unlike = tuple(robot for robot, one in known.items() if _own(one) != keys)
    return Learnt(nominal, parameters, found, unlike, tuple(leaning))


def _result(own: Done) -> Path:
    (path,) = [Path(file) for file, _ in own.files if file.endswith(".identify.json")]
    return path


def _own(known: Known) -> tuple[Key, ...]:
    """Parameters of the robot itself, in an order of their own."""
    return tuple(sorted(key for key in known.keys if lasting(key)))


def _robot(name: str, known: Known, keys: tuple[Key, ...]) -> Robot:
    at = [known.keys.index(key) for key in keys]
    _, V = known.ignorance()
    return Robot(name, known.values[at], known.noise()[np.ix_(at, at)], V[at])


def _parameters(own: Done, keys: tuple[Key, ...]) -> tuple[Parameter, ...]:
    cell = load_cell(own.cell)
    by_key = {
        (p.effect, p.where, p.name): p for p in load_estimate(cell, _result(own)).model.parameters
    }
    if not by_key.keys() >= set(keys):
        raise InputError(_result(own), "estimate", "is not of its cell", "run the fleet anew")
    return tuple(by_key[key] for key in keys)
