"""No bound is broken: small problems of every criterion, each plan of them judged one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from doe.criteria import Criterion
from doe.criteria.trace import Task
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.function import Selection
from doe.optimal.relax import bounded, relax
from doe.optimal.search import best_plan, exchange
from tests.doe.problems import best_by_exhaustion, criteria, grouped, random_blocks

SMOOTH = ["D", "A", "c", "task", "task, one target", "task, itself a target"]
KINKED = ["Ds", "E", "E of two", "task-worst", "rivals"]
ROUNDING = 1e-7


def small(rng: np.random.Generator, name: str) -> tuple[Criterion, Blocks, Allowed]:
    """Plans of 3 to 5 of 8 to 12 candidates, with levels, with repeats, or neither."""
    n, p, size = (int(rng.integers(*ends, endpoint=True)) for ends in ((8, 12), (2, 5), (3, 5)))
    rows = int(rng.integers(max(1, -(-p // size)), 4))
    blocks = random_blocks(rng, n, p, rows)
    levels = 2 if size == 4 and n >= 8 and rng.uniform() < 0.3 else 1
    allowed = grouped(n, levels, size // levels, repeats=bool(rng.uniform() < 0.4))
    return criterion_of(rng, name, blocks), blocks, allowed


def criterion_of(rng: np.random.Generator, name: str, blocks: Blocks) -> Criterion:
    """The criterion; a task at one target asks for fewer directions than there are."""
    p = len(blocks.fixed)
    if name == "task, one target":
        return Task.of_rows(rng.normal(size=(min(2, p), p)))
    if name == "task, itself a target":
        return Task.of_rows(blocks.rows[int(rng.integers(len(blocks)))])
    if name == "task":
        return Task.of_rows(rng.normal(size=(8, p)))
    return criteria(rng, p)[name] if p > 2 or name != "rivals" else criteria(rng, p)["E"]


def broken(name: str, seed: int) -> Array:
    """What the best plan of all, and what ours, have over the bound, relative."""
    rng = np.random.default_rng([seed, len(name)])
    criterion, blocks, allowed = small(rng, name)
    posed = Selection(criterion, blocks, allowed)
    relaxed = relax(posed)
    plan = best_plan(posed, relaxed, seed=0).plan
    plain = criterion.plain
    if plain is not criterion:
        relaxed = bounded(replace(posed, criterion=plain), relaxed)
    optimum, _ = best_by_exhaustion(plain, blocks, allowed)
    ours = float(plain.value(blocks.total(plan)))
    assert allowed.admits(plan)
    assert ours <= optimum * (1.0 + ROUNDING)
    assert relaxed.bound <= optimum * 10.0  # a bound that bounds nothing would pass too
    return np.array([optimum, ours]) / relaxed.bound - 1.0


@pytest.mark.parametrize("name", SMOOTH + KINKED)
@pytest.mark.parametrize("first", [0, pytest.param(1000, marks=pytest.mark.long)])
def test_no_bound_is_broken(name: str, first: int) -> None:
    """Of a few problems of each criterion; of five hundred in all where there is time."""
    count = 45 if first else 6 if name in SMOOTH else 3
    over = np.array([broken(name, first + seed) for seed in range(count)])
    assert over.max() <= ROUNDING


def test_a_bound_of_the_criterion_with_its_share_is_none_of_the_plain_one() -> None:
    """One target that is a candidate: measuring it again and again is best, and says nothing else."""
    rng = np.random.default_rng(5)
    drawn = random_blocks(rng, 10, 4, 2)
    blocks = Blocks(
        drawn.packed * np.where(np.arange(10) == 3, 100.0, 1.0)[:, None], drawn.fixed, 2
    )
    criterion = Task.of_rows(blocks.rows[3])
    allowed = grouped(10, 1, 3, repeats=True)
    posed = Selection(criterion, blocks, allowed)
    relaxed = relax(posed)
    optimum, plan = best_by_exhaustion(criterion.plain, blocks, allowed)
    assert (plan == 3).all()
    assert optimum > relaxed.bound
    assert optimum <= bounded(replace(posed, criterion=criterion.plain), relaxed).bound * (
        1.0 + ROUNDING
    )


# What ranks candidates of few poses, and the plans that are found, against ways that share
# nothing ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["D", "A", "task", "E"])
@pytest.mark.parametrize("poses", [3, 8])
def test_an_exchange_ends_where_no_pose_is_better_elsewhere(name: str, poses: int) -> None:
    """Every candidate tried in place of every pose; of three poses, two alone leave the model open."""
    rng = np.random.default_rng(poses)
    blocks, allowed = random_blocks(rng, 200, 6, 2), grouped(200, 1, poses)
    criterion = criteria(rng, 6)[name]
    plan, value = exchange(Selection(criterion, blocks, allowed), np.arange(poses))
    for slot in range(poses):
        rest = np.delete(plan, slot)
        for other in np.setdiff1d(np.arange(200), plan):
            tried = float(criterion.value(blocks.total(np.append(rest, other))))
            assert tried <= value * (1.0 + 1e-6)
