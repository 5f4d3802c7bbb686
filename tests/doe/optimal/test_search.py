"""What ranks candidates of few poses, and the plans that are found, against ways that share nothing."""

from __future__ import annotations

import numpy as np
import pytest

from doe.optimal.covariance import exchanged, fall, growth, lessened
from doe.optimal.relax import relax
from doe.optimal.search import best_plan
from tests.doe.problems import best_by_exhaustion, criteria, grouped, random_blocks


def test_updates_of_a_covariance_are_those_of_whole_inverses() -> None:
    rng = np.random.default_rng(0)
    plan, into = rng.normal(size=(3, 4, 5)), rng.normal(size=(6, 4, 5))
    M, out = np.einsum("nrp,nrq->pq", plan, plan), plan[0]
    C, W = np.linalg.inv(M), np.diag(rng.uniform(0.5, 2.0, 5))
    further = np.swapaxes(into, 1, 2) @ into
    without = lessened(C[None], out[None], 0.9)[0]
    np.testing.assert_allclose(without, np.linalg.inv(M - 0.9 * out.T @ out))
    others = exchanged(C[None], out[None], into[None])[0]
    np.testing.assert_allclose(others, np.linalg.inv(M - out.T @ out + further))
    lowered = np.trace(W @ (C - np.linalg.inv(M + further)), axis1=1, axis2=2)
    np.testing.assert_allclose(fall(C, C @ W @ C, into), lowered)
    raised = np.linalg.slogdet(M + further)[1] - np.linalg.slogdet(M)[1]
    np.testing.assert_allclose(growth(C, into), raised)


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
