"""Exchanges and whole searches against every candidate in every place, and every plan."""

from __future__ import annotations

import numpy as np
import pytest

from doe.optimal.exchange import exchange
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from tests.doe.problems import best_by_exhaustion, criteria, grouped, random_blocks


@pytest.mark.parametrize("name", ["D", "A", "task", "E"])
@pytest.mark.parametrize("poses", [3, 8])
def test_an_exchange_ends_where_no_pose_is_better_elsewhere(name: str, poses: int) -> None:
    """Every candidate tried in place of every pose; of three poses, two alone leave the model open."""
    rng = np.random.default_rng(poses)
    blocks, allowed = random_blocks(rng, 200, 6, 2), grouped(200, 1, poses)
    criterion = criteria(rng, 6)[name]
    plan, value = exchange(criterion, blocks, allowed, np.arange(poses))
    for slot in range(poses):
        rest = np.delete(plan, slot)
        for other in np.setdiff1d(np.arange(200), plan):
            tried = float(criterion.value(blocks.total(np.append(rest, other))))
            assert tried <= value * (1.0 + 1e-6)


@pytest.mark.parametrize("name", ["D", "A", "E"])
@pytest.mark.parametrize("seed", range(3))
def test_the_best_of_all_plans_is_found(name: str, seed: int) -> None:
    """Three poses of two rows for six parameters: the fewest that can do."""
    rng = np.random.default_rng(seed)
    blocks, allowed = random_blocks(rng, 22, 6, 2), grouped(22, 1, 3)
    criterion = criteria(rng, 6)[name]
    found = best_plan(criterion, blocks, allowed, relax(criterion, blocks, allowed), seed=0)
    optimum, _ = best_by_exhaustion(criterion, blocks, allowed)
    assert found.value == pytest.approx(optimum, rel=1e-6)
