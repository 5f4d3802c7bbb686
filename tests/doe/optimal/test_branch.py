"""Branch and bound against the best of all plans, and where a pool is full of neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.branch import Proof, prove
from doe.optimal.relax import relax
from doe.optimal.selection import Selection
from tests.doe.problems import best_by_exhaustion, criteria, grouped, plans, random_blocks

RULES = {
    "free": grouped(12, 1, 4),
    "levels": grouped(15, 3, 2),
    "repeats": grouped(9, 3, 2, repeats=True),
    "free repeats": grouped(9, 1, 4, repeats=True),
}


def proofs(name: str, rules: str, seed: int) -> tuple[float, list[Proof]]:
    """The best criterion of all plans, and what is proved after each node from the worst plan on."""
    rng, allowed, steps = np.random.default_rng(10 + seed), RULES[rules], []
    criterion, blocks = criteria(rng, 4)[name], random_blocks(rng, len(allowed.group), 4)
    optimum, _ = best_by_exhaustion(criterion, blocks, allowed)
    worst = min(plans(allowed), key=lambda plan: float(criterion.value(blocks.total(plan))))
    posed = Selection(criterion, blocks, allowed)
    G = relax(posed).G
    end = prove(posed, worst, G, most_work=np.inf, told=steps.append)
    assert allowed.admits(end.plan)
    return optimum, [*steps, end]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rules", RULES)
@pytest.mark.parametrize("name", ["D", "A", "task"])
def test_against_exhaustion(name: str, rules: str, seed: int) -> None:
    """From the worst plan of all it ends at the best one and says so; on the way no bound is broken."""
    optimum, steps = proofs(name, rules, seed)
    assert steps[-1].optimal
    assert steps[-1].value == pytest.approx(optimum, rel=1e-8)
    for proof in steps:
        assert proof.value * (1.0 - 1e-9) <= optimum <= proof.bound * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["D", "A", "task"])
def test_neighbours_cost_little(name: str) -> None:
    """Forty near copies of each candidate: to shut out one says nothing, yet the plan is proved."""
    rng = np.random.default_rng(3)
    J = rng.normal(size=(20, 1, 3, 4)) * (1.0 + 0.01 * rng.normal(size=(1, 40, 1, 4)))
    J = J.reshape(-1, 3, 4)
    blocks = Blocks(pack(np.swapaxes(J, 1, 2) @ J), 1e-9 * np.eye(4), 3)
    allowed = Allowed(np.zeros(len(J), dtype=int), np.zeros(1), np.array([5]), 1)
    criterion = criteria(rng, 4)[name]
    posed = Selection(criterion, blocks, allowed)
    relaxed = relax(posed)
    begin = np.arange(0, 200, 40)
    assert prove(posed, begin, relaxed.G, most_work=np.inf).optimal
    few = prove(posed, begin, relaxed.G, most_work=1.0)
    assert few.nodes == 0
    assert few.bound == pytest.approx(relaxed.bound, rel=1e-9)
