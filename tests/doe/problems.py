"""Small random design problems with known answers by exhaustive search; plans that take little time."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np

import doe
from calib import Cell
from calib.arrays import Array, IntArray
from calib.poses import poses_at
from doe.candidates import drawn
from doe.criteria import Criterion
from doe.criteria.determinant import Determinant, Subset
from doe.criteria.smallest import Rivals, SmallestEigenvalue, WorstRegion
from doe.criteria.trace import Average, Combination, Task
from doe.levels import levels_of, parse_levels
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack

RIDGE = 1e-10


def random_blocks(rng: np.random.Generator, n: int, p: int, rows: int = 3) -> Blocks:
    """Information of n candidates of several rows each, the mean about the identity."""
    J = rng.normal(size=(n, rows, p)) * rng.uniform(0.3, 1.5, (n, 1, 1)) / np.sqrt(rows)
    return Blocks(pack(np.swapaxes(J, -1, -2) @ J), RIDGE * np.eye(p), min(rows, p))


def grouped(
    n: int, levels: int, per_level: int, used: int | None = None, **more: object
) -> Allowed:
    """Candidates dealt to levels in turn."""
    return Allowed(
        np.arange(n) % levels,
        np.arange(levels, dtype=float),
        np.full(levels, per_level),
        levels if used is None else used,
        **more,  # type: ignore[arg-type]
    )


def criteria(rng: np.random.Generator, p: int, change: Array | None = None) -> dict[str, Criterion]:
    """One of each kind, with nothing special about it.

    change : matrix (p, p) by which coordinates are those of others, y = change y'
    """
    change = np.eye(p) if change is None else change
    V = (rng.normal(size=(p, p)) + 2.0 * np.eye(p)) @ change
    F = rng.normal(size=(4, 2, p)) @ change
    return {
        "D": Determinant(V),
        "Ds": Subset(V[:2]),
        "A": Average(V.T),
        "c": Combination(V[:1].T),
        "task": Task(np.concatenate(list(F)).T),
        "E": SmallestEigenvalue(V),
        "E of two": SmallestEigenvalue(V[:2]),
        "G": WorstRegion(np.swapaxes(F, -1, -2)),
        "rivals": Rivals((V[:1], V[1:3])),
    }


def plans(allowed: Allowed) -> list[IntArray]:
    """Every plan, by plain enumeration of the rules."""
    choose = itertools.combinations_with_replacement if allowed.repeats else itertools.combinations
    found = []
    for used in itertools.combinations(range(len(allowed.positions)), allowed.used):
        positions = allowed.positions[list(used)]
        if len(used) > 1 and np.diff(positions).min() < allowed.separation - 1e-12:
            continue
        inside = [choose(np.flatnonzero(allowed.group == g), allowed.counts[g]) for g in used]
        found += [np.concatenate(parts) for parts in itertools.product(*map(list, inside))]
    return [np.array(plan, dtype=int) for plan in found]


def best_by_exhaustion(
    criterion: Criterion, blocks: Blocks, allowed: Allowed
) -> tuple[float, IntArray]:
    """The best plan of all, judged one by one."""
    every = plans(allowed)
    totals = np.array([blocks.total(plan) for plan in every])
    values = criterion.value(totals)
    best = int(values.argmax())
    return float(values[best]), every[best]


def random_information(rng: np.random.Generator, p: int) -> Array:
    """A positive definite matrix."""
    A = rng.normal(size=(p, p + 2))
    return np.asarray(A @ A.T)


def unpolished(
    cell: Cell,
    *,
    candidates: int,
    levels: str | None = None,
    poses: int | None = None,
    **asked: Any,
) -> doe.Design:
    """The plan of drawn candidates alone: those of a table are left as they are."""
    at = levels_of(cell, None if levels is None else parse_levels(cell, levels), poses)
    q = np.concatenate(list(drawn(cell, candidates, at, 0)))
    return doe.design(cell, candidates=poses_at(q), levels=levels, poses=poses, **asked)


def visiting_again(cell: Cell, count: int) -> Cell:
    """The cell whose plans visit so many poses again."""
    return replace(cell, design=replace(cell.design, reapproaches=count))
