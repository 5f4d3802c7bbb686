"""Problems as a statistician states them: no plan, however it is found, is above its bound."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import Array, IntArray
from doe.criteria import Criterion
from doe.criteria.determinant import Determinant, Subset
from doe.criteria.smallest import SmallestEigenvalue, WorstRegion
from doe.criteria.trace import Average, Combination, Task
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, pack
from doe.optimal.function import Selection
from doe.optimal.relax import relax
from doe.optimal.search import best_plan

CRITERIA = ("D", "A", "c", "E", "G", "Ds", "task")
LONG = [(9, 10_000, 20), (16, 1_000, 32)]
SIZES = [(3, 200, 6), *(pytest.param(*size, marks=pytest.mark.long) for size in LONG)]


def criterion_of(name: str, J: Array, rng: np.random.Generator) -> Criterion:
    """With parameters of unlike units that are no coordinates of the rows."""
    p = J.shape[2]
    V = (np.eye(p) + 0.3 * rng.normal(size=(p, p))) * 10.0 ** rng.uniform(-1.0, 1.0, (p, 1))
    region = np.swapaxes(J[rng.choice(len(J), 40, replace=False)], 1, 2)
    of: dict[str, Criterion] = {
        "D": Determinant(V),
        "A": Average(V.T),
        "c": Combination(V[:1].T),
        "E": SmallestEigenvalue(np.eye(p)),
        "G": WorstRegion(region),
        "Ds": Subset(V[: max(1, p // 3)]),
        "task": Task.of_rows(rng.normal(size=(3 * p, p))),
    }
    return of[name].plain


def polynomial(p: int, count: int, rng: np.random.Generator) -> Array:
    """Rows (n, 2, p) of two responses, a random cosine basis of six factors, mean information one."""
    x = rng.uniform(-1.0, 1.0, (count, 6))
    J = np.cos(x @ rng.normal(size=(2, 6, p)) * 2.0 + rng.uniform(0.0, 6.0, p)).swapaxes(0, 1)
    mean = np.einsum("nrp,nrq->pq", J, J) / count
    return np.asarray(J @ np.linalg.inv(np.linalg.cholesky(mean)).T)


def plans(J: Array, scores: Array, poses: int, rng: np.random.Generator) -> list[IntArray]:
    """By chance, by chance of what the bound prices highest, and that itself."""
    top = np.argsort(-scores)[: 3 * poses]
    chance = [rng.choice(len(J), poses, replace=False) for _ in range(200)]
    return [*chance, *(rng.choice(top, poses, replace=False) for _ in range(300)), top[:poses]]


@pytest.mark.parametrize(("p", "count", "poses"), SIZES)
@pytest.mark.parametrize("name", CRITERIA)
def test_no_plan_is_above_the_bound(name: str, p: int, count: int, poses: int) -> None:
    rng = np.random.default_rng([p, CRITERIA.index(name)])
    J = polynomial(p, count, rng)
    blocks = Blocks(pack(np.swapaxes(J, 1, 2) @ J), 1e-10 * np.eye(p), 2)
    criterion = criterion_of(name, J, rng)
    posed = Selection(criterion, blocks, Allowed.any_of(count, poses))
    relaxed = relax(posed)
    # The bound again, by a plain sort of what each candidate is worth.
    scores = np.einsum("nrp,pq,nrq->n", J, relaxed.G, J)
    again = np.sort(scores)[-poses:].sum() + 1e-10 * np.trace(relaxed.G)
    assert relaxed.bound == pytest.approx(again, rel=1e-9)
    found = best_plan(posed, relaxed, seed=0)
    M = np.array([blocks.total(plan) for plan in plans(J, scores, poses, rng)])
    assert criterion.value(M).max() <= relaxed.bound * (1.0 + 1e-9)
    assert criterion.value(M).max() <= found.value * (1.0 + 1e-9) <= relaxed.bound * (1.0 + 2e-9)
