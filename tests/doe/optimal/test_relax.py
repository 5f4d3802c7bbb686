"""Relaxation, certificate and exchange against exhaustive search."""

from __future__ import annotations

import numpy as np
import pytest

from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.relax import conic_weights, newton_weights, relax
from doe.optimal.search import best_plan, exchange
from tests.doe.problems import best_by_exhaustion, criteria, grouped, random_blocks

P = 4
NAMES = list(criteria(np.random.default_rng(0), P))
RULES = {
    "free": grouped(40, 1, 6),
    "levels": grouped(40, 4, 2),
    "repeats": grouped(40, 4, 2, repeats=True),
    "levels to choose": grouped(48, 8, 2, used=3, separation=2.0),
    "levels at any distance": grouped(48, 8, 2, used=3),
}


def setting(name: str, rules: str, seed: int = 2) -> tuple:
    rng = np.random.default_rng(seed)
    allowed = RULES[rules]
    return criteria(rng, P)[name], random_blocks(rng, len(allowed.group), P), allowed


def random_plan(rng: np.random.Generator, allowed: Allowed) -> np.ndarray:
    _, plan = allowed.best(rng.uniform(size=len(allowed.group)))
    return plan


@pytest.mark.parametrize("rules", RULES)
@pytest.mark.parametrize("name", NAMES)
def test_certified_to_the_gap(name: str, rules: str) -> None:
    criterion, blocks, allowed = setting(name, rules)
    posed = Selection(criterion, blocks, allowed)
    relaxed = relax(posed)
    assert -1e-9 <= relaxed.gap <= 1e-4
    # The weights are a weighted plan: sums, caps, and the matrix that belongs to them.
    sums = np.bincount(allowed.group[relaxed.index], relaxed.weights, len(allowed.positions))
    assert sums.sum() == pytest.approx(allowed.size, rel=1e-5)
    if not allowed.chooses_levels:
        np.testing.assert_allclose(sums, allowed.counts, rtol=1e-4)
    if not allowed.repeats:
        assert relaxed.weights.max() <= 1.0 + 1e-5
    np.testing.assert_allclose(relaxed.M, blocks.total(relaxed.index, relaxed.weights))
    assert posed.bound(relaxed.G) == pytest.approx(relaxed.bound, rel=1e-9)


@pytest.mark.parametrize("name", ["D", "A", "c", "task"])
@pytest.mark.parametrize("rules", ["free", "levels", "repeats"])
def test_both_masters_agree(name: str, rules: str) -> None:
    """The interior point method against cvxpy and clarabel."""
    criterion, blocks, allowed = setting(name, rules)
    everyone = np.arange(len(blocks))
    posed = Selection(criterion, blocks, allowed)
    by_newton = blocks.total(everyone, newton_weights(posed, 1e-6))
    solved = conic_weights(posed, np.eye(P)[None])
    assert solved is not None
    by_cone = blocks.total(everyone, solved[0])
    assert criterion.value(by_newton) == pytest.approx(float(criterion.value(by_cone)), rel=1e-5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("rules", RULES)
def test_exchange_never_worsens(name: str, rules: str) -> None:
    criterion, blocks, allowed = setting(name, rules)
    rng = np.random.default_rng(9)
    for _ in range(5):
        start = random_plan(rng, allowed)
        before = float(criterion.value(blocks.total(start)))
        plan, value = exchange(Selection(criterion, blocks, allowed), start)
        assert value >= before
        assert value == pytest.approx(float(criterion.value(blocks.total(plan))), rel=1e-9)
        assert allowed.admits(plan)


SMALL = {
    "free": grouped(14, 1, 4),
    "levels": grouped(15, 3, 2),
    "repeats": grouped(9, 3, 2, repeats=True),
    "levels to choose": grouped(16, 8, 1, used=4, separation=2.0),
}


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("rules", SMALL)
@pytest.mark.parametrize("name", ["D", "A", "task", "E", "task-worst"])
def test_search_against_exhaustion(name: str, rules: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    allowed = SMALL[rules]
    criterion, blocks = criteria(rng, P)[name], random_blocks(rng, len(allowed.group), P)
    optimum, _ = best_by_exhaustion(criterion, blocks, allowed)
    posed = Selection(criterion, blocks, allowed)
    relaxed = relax(posed)
    value = best_plan(posed, relaxed, seed=0).value
    assert relaxed.bound >= optimum * (1.0 - 1e-9)
    assert value <= optimum * (1.0 + 1e-9)
    assert value >= 0.999 * optimum


def test_fixed_rows_count() -> None:
    """Poses that are measured in any case change what is best, and the bound knows of them."""
    criterion, blocks, allowed = setting("D", "free")
    fixed = Blocks(blocks.packed, blocks.total(np.arange(5)), blocks.rank)
    beside = Selection(criterion, fixed, allowed)
    relaxed = relax(beside)
    found = best_plan(beside, relaxed, seed=0)
    plan, value = found.plan, found.value
    assert value <= relaxed.bound * (1.0 + 1e-9)
    assert value >= 0.95 * relaxed.bound
    posed = Selection(criterion, blocks, allowed)
    free = relax(posed)
    alone = best_plan(posed, free, seed=0).plan
    assert value >= float(criterion.value(fixed.total(alone)))
    assert set(plan) != set(alone)


def test_near_singular_plans_do_not_break_the_search() -> None:
    """Rank-one candidates, most of them alike: only one plan determines everything."""
    rng = np.random.default_rng(3)
    J = np.repeat(rng.normal(size=(1, 1, P)), 30, axis=0)
    J[:4, 0] = np.eye(P)
    blocks = Blocks(pack(np.swapaxes(J, -1, -2) @ J), 1e-10 * np.eye(P), 1)
    allowed = grouped(30, 1, 4)
    criterion = criteria(rng, P)["D"]
    posed = Selection(criterion, blocks, allowed)
    relaxed = relax(posed)
    plan = best_plan(posed, relaxed, seed=0).plan
    assert np.linalg.matrix_rank(blocks.total(plan), tol=1e-6) == P
