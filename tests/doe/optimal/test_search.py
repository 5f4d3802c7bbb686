"""What ranks candidates of few poses, and the plans that are found, against ways that share nothing."""

from __future__ import annotations

import numpy as np
import pytest

from doe.optimal.blocks import fall, growth, lessened
from doe.optimal.exchange import exchange
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from tests.doe.problems import best_by_exhaustion, criteria, grouped, random_blocks


def test_updates_of_a_covariance_are_those_of_whole_inverses() -> None:
    rng = np.random.default_rng(0)
    plan, into = rng.normal(size=(3, 4, 5)), rng.normal(size=(6, 4, 5))
    M, out = np.einsum("nrp,nrq->pq", plan, plan), plan[0]
    C, W = np.linalg.inv(M), np.diag(rng.uniform(0.5, 2.0, 5))
    further = np.swapaxes(into, 1, 2) @ into
    without = lessened(C, out, 0.9)
    np.testing.assert_allclose(without, np.linalg.inv(M - 0.9 * out.T @ out))
    lowered = np.trace(W @ (C - np.linalg.inv(M + further)), axis1=1, axis2=2)
    np.testing.assert_allclose(fall(C, C @ W @ C, into), lowered)
    raised = np.linalg.slogdet(M + further)[1] - np.linalg.slogdet(M)[1]
    np.testing.assert_allclose(growth(C, into), raised)


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
