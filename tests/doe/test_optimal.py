"""Relaxation, certificate and search on problems of plain matrices, against exhaustive search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from doe.criteria.trace import Task
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.relax import bounded, conic_weights, newton_weights, relax
from doe.optimal.search import best_plan, exchange
from tests.doe.problems import best_by_exhaustion, criteria, grouped, plans, random_blocks

P = 4
ROUNDING = 1e-7
NAMES = list(criteria(np.random.default_rng(0), P))
SMOOTH = ["D", "A", "c", "task", "task, one target", "task, itself a target"]
KINKED = ["Ds", "E", "E of two", "G", "rivals"]
RULES = {
    "free": grouped(40, 1, 6),
    "levels": grouped(40, 4, 2),
    "repeats": grouped(40, 4, 2, repeats=True),
    "levels to choose": grouped(48, 8, 2, used=3, separation=2.0),
    "levels at any distance": grouped(48, 8, 2, used=3),
}
SMALL = {
    "one group": grouped(9, 1, 4),
    "levels": grouped(12, 3, 2),
    "repeats": grouped(6, 2, 3, repeats=True),
    "levels to choose": grouped(15, 5, 2, used=2),
    "apart": grouped(16, 8, 1, used=4, separation=2.0),
    "apart, repeats": grouped(12, 6, 2, used=2, separation=3.0, repeats=True),
}


@pytest.mark.parametrize("name", SMALL)
def test_the_linear_oracle_finds_the_best_of_all_plans(name: str) -> None:
    allowed, rng = SMALL[name], np.random.default_rng(1)
    every = plans(allowed)
    for _ in range(20):
        scores = rng.uniform(0.0, 1.0, len(allowed.group))
        sums = np.array([scores[plan].sum() for plan in every])
        value, plan = allowed.best(scores)
        assert value == pytest.approx(sums.max(), rel=1e-12)
        assert scores[plan].sum() == pytest.approx(value, rel=1e-12)
        assert any(np.array_equal(np.sort(plan), np.sort(other)) for other in every)


@pytest.mark.parametrize(
    ("plan", "admitted"),
    [
        ([0, 6, 2, 8], True),
        ([0, 6, 1, 7], False),  # too close
        ([0, 6, 0, 6], False),  # one level, twice
        ([0, 2, 4, 8], False),  # three levels
        ([0, 0, 2, 8], False),  # a candidate twice
    ],
)
def test_what_is_no_plan(plan: list[int], admitted: bool) -> None:
    assert grouped(12, 6, 2, used=2, separation=2.0).admits(np.array(plan)) is admitted


def test_levels_without_enough_candidates_are_not_used() -> None:
    allowed = grouped(7, 4, 2, used=3)  # the last level has one candidate only
    value, plan = allowed.best(np.r_[np.zeros(3), 10.0, np.zeros(3)])
    assert value == 0.0
    assert 3 not in allowed.group[plan]


def posed(name: str, rules: str, seed: int = 2) -> Selection:
    allowed, rng = RULES[rules], np.random.default_rng(seed)
    return Selection(criteria(rng, P)[name], random_blocks(rng, len(allowed.group), P), allowed)


@pytest.mark.parametrize("rules", RULES)
@pytest.mark.parametrize("name", NAMES)
def test_certified_to_the_gap_and_exchanged_for_the_better(name: str, rules: str) -> None:
    """The weights are a weighted plan: sums, caps, and the matrix that belongs to them."""
    problem = posed(name, rules)
    allowed, blocks = problem.allowed, problem.blocks
    relaxed = relax(problem)
    # The worst of several have no cone form: their bound is found by steps.
    assert -1e-9 <= relaxed.gap <= {"rivals": 0.2, "G": 0.03}.get(name, 1e-4)
    sums = np.bincount(allowed.group[relaxed.index], relaxed.weights, len(allowed.positions))
    assert sums.sum() == pytest.approx(allowed.size, rel=1e-5)
    if not allowed.chooses_levels:
        np.testing.assert_allclose(sums, allowed.counts, rtol=1e-4)
    if not allowed.repeats:
        assert relaxed.weights.max() <= 1.0 + 1e-5
    np.testing.assert_allclose(relaxed.M, blocks.total(relaxed.index, relaxed.weights))
    assert problem.bound(relaxed.G) == pytest.approx(relaxed.bound, rel=1e-9)
    rng = np.random.default_rng(9)
    for _ in range(5):
        _, start = allowed.best(rng.uniform(size=len(allowed.group)))
        plan, value = exchange(problem, start)
        assert value >= float(problem.criterion.value(blocks.total(start)))
        assert value == pytest.approx(float(problem.criterion.value(blocks.total(plan))), rel=1e-9)
        assert allowed.admits(plan)


@pytest.mark.parametrize("name", ["D", "A", "c", "task"])
@pytest.mark.parametrize("rules", ["free", "levels", "repeats"])
def test_both_masters_agree(name: str, rules: str) -> None:
    """The interior point method against cvxpy and clarabel."""
    problem = posed(name, rules)
    everyone = np.arange(len(problem.blocks))
    solved = conic_weights(problem)
    assert solved is not None
    newton, cone = (
        float(problem.criterion.value(problem.blocks.total(everyone, weights)))
        for weights in (newton_weights(problem, 1e-6), solved[0])
    )
    assert newton == pytest.approx(cone, rel=1e-5)


def small(rng: np.random.Generator, name: str, allowed: Allowed) -> Selection:
    """A problem of which every plan can be judged; a task at one target asks for few directions."""
    p = int(rng.integers(3, 5, endpoint=True))
    rows = int(rng.integers(-(-p // allowed.size), 3, endpoint=True))
    blocks = random_blocks(rng, len(allowed.group), p, rows)
    tasks = {"task, one target": rng.normal(size=(2, p)), "task, itself a target": blocks.rows[0]}
    criterion = Task.of_rows(tasks[name]) if name in tasks else criteria(rng, p)[name]
    return Selection(criterion, blocks, allowed)


@pytest.mark.parametrize("name", SMOOTH + KINKED)
@pytest.mark.parametrize("first", [0, pytest.param(100, marks=pytest.mark.long)])
def test_no_bound_is_broken_and_the_best_plan_found(name: str, first: int) -> None:
    """Against the best of all plans, one rule after the other.

    The search is sure to find it where a plan has thrice as many readings as there are parameters.
    """
    turn = (SMOOTH + KINKED).index(name)
    for seed in range(first, first + (5 if first else 3)):
        rules = list(SMALL)[(turn + seed) % len(SMALL)]
        problem = small(np.random.default_rng([seed, turn]), name, SMALL[rules])
        relaxed = relax(problem)
        plan = best_plan(problem, relaxed, seed=0).plan
        plain = problem.criterion.plain
        if plain is not problem.criterion:
            relaxed = bounded(replace(problem, criterion=plain), relaxed)
        optimum, _ = best_by_exhaustion(plain, problem.blocks, problem.allowed)
        ours = float(plain.value(problem.blocks.total(plan)))
        assert problem.allowed.admits(plan)
        assert ours <= optimum * (1.0 + ROUNDING)
        if problem.blocks.rank * problem.allowed.size >= 3 * len(problem.blocks.fixed):
            assert ours >= 0.999 * optimum, rules
            assert relaxed.bound <= 2.0 * optimum  # one that bounds nothing would pass, too
        assert optimum <= relaxed.bound * (1.0 + ROUNDING), rules


def test_a_bound_of_the_criterion_with_its_share_is_none_of_the_plain_one() -> None:
    """One target that is a candidate: measuring it again and again is best, and says nothing else."""
    rng = np.random.default_rng(5)
    drawn = random_blocks(rng, 10, 4, 2)
    louder = np.where(np.arange(10) == 3, 100.0, 1.0)[:, None]
    blocks = Blocks(drawn.packed * louder, drawn.fixed, 2)
    criterion, allowed = Task.of_rows(blocks.rows[3]), grouped(10, 1, 3, repeats=True)
    problem = Selection(criterion, blocks, allowed)
    relaxed = relax(problem)
    optimum, plan = best_by_exhaustion(criterion.plain, blocks, allowed)
    assert (plan == 3).all()
    assert optimum > relaxed.bound
    plain = bounded(replace(problem, criterion=criterion.plain), relaxed)
    assert optimum <= plain.bound * (1.0 + ROUNDING)


@pytest.mark.parametrize("name", ["D", "A", "task", "E"])
@pytest.mark.parametrize("poses", [3, 8])
def test_an_exchange_ends_where_no_pose_is_better_elsewhere(name: str, poses: int) -> None:
    """Every candidate tried in place of every pose; of three poses, two alone leave the model open."""
    rng = np.random.default_rng(poses)
    blocks, allowed = random_blocks(rng, 200, 6, 2), grouped(200, 1, poses)
    criterion = criteria(rng, 6)[name]
    plan, value = exchange(Selection(criterion, blocks, allowed), np.arange(poses))
    for slot in range(poses):
        rest = blocks.total(np.delete(plan, slot))
        others = np.setdiff1d(np.arange(200), plan)
        tried = criterion.value(rest + np.array([blocks.total([k]) for k in others]) - blocks.fixed)
        assert np.max(tried) <= value * (1.0 + 1e-6)


def test_fixed_rows_count() -> None:
    """Poses that are measured in any case change what is best, and the bound knows of them."""
    free = posed("D", "free")
    given = free.blocks.total(np.arange(5))
    beside = replace(free, blocks=Blocks(free.blocks.packed, given, free.blocks.rank))
    relaxed = relax(beside)
    found = best_plan(beside, relaxed, seed=0)
    assert 0.95 * relaxed.bound <= found.value <= relaxed.bound * (1.0 + 1e-9)
    alone = best_plan(free, relax(free), seed=0).plan
    assert found.value >= float(free.criterion.value(beside.blocks.total(alone)))
    assert set(found.plan) != set(alone)


def test_near_singular_plans_do_not_break_the_search() -> None:
    """Rank-one candidates, most of them alike: only one plan determines everything."""
    rng = np.random.default_rng(3)
    J = np.repeat(rng.normal(size=(1, 1, P)), 30, axis=0)
    J[:4, 0] = np.eye(P)
    blocks = Blocks(pack(np.swapaxes(J, -1, -2) @ J), 1e-10 * np.eye(P), 1)
    problem = Selection(criteria(rng, P)["D"], blocks, grouped(30, 1, 4))
    plan = best_plan(problem, relax(problem), seed=0).plan
    assert np.linalg.matrix_rank(blocks.total(plan), tol=1e-6) == P


@pytest.mark.parametrize(
    ("p", "count", "poses"),
    [
        (3, 200, 6),
        pytest.param(6, 10_000, 14, marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("name", ["D", "A", "c", "E", "G", "Ds", "task"])
def test_no_plan_by_chance_is_above_the_bound(name: str, p: int, count: int, poses: int) -> None:
    """By chance of all, by chance of what the bound prices highest, and that itself."""
    rng = np.random.default_rng([p, poses])
    blocks, criterion = random_blocks(rng, count, p, 2), criteria(rng, p)[name]
    problem = Selection(criterion, blocks, Allowed.any_of(count, poses))
    relaxed = relax(problem)
    # The bound again, by a plain sort of what each candidate is worth.
    scores = np.einsum("nrp,pq,nrq->n", blocks.rows, relaxed.G, blocks.rows)
    again = np.sort(scores)[-poses:].sum() + np.trace(blocks.fixed @ relaxed.G)
    assert relaxed.bound == pytest.approx(again, rel=1e-9)
    found, top = best_plan(problem, relaxed, seed=0), np.argsort(-scores)[: 3 * poses]
    chance = [rng.choice(count, poses, replace=False) for _ in range(200)]
    chance += [rng.choice(top, poses, replace=False) for _ in range(300)]
    most = criterion.value(np.array([blocks.total(plan) for plan in (*chance, top[:poses])])).max()
    assert most <= found.value * (1.0 + 1e-9) <= relaxed.bound * (1.0 + 2e-9)
