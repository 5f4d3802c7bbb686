"""Orders against every permutation."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from calib.arrays import Array
from doe.order import shortest_order


def costs(n: int, seed: int) -> Array:
    """Of the joint that goes farthest between random poses."""
    x = np.random.default_rng(seed).uniform(size=(n, 6))
    return np.asarray(np.abs(x[:, None] - x).max(axis=-1))


def along(cost: Array, order: Array) -> float:
    return float(cost[order[:-1], order[1:]].sum())


@pytest.mark.parametrize("n", range(2, 9))
def test_against_every_order(n: int) -> None:
    every = np.array(list(itertools.permutations(range(n))))
    for seed in range(10):
        cost = costs(n, seed)
        best = cost[every[:, :-1], every[:, 1:]].sum(axis=1).min()
        order = shortest_order(cost)
        assert sorted(order) == list(range(n))
        assert along(cost, order) == pytest.approx(best)


@pytest.mark.parametrize("n", [15, 30, 60])
def test_it_is_much_shorter_than_the_given_order(n: int) -> None:
    for seed in range(5):
        cost = costs(n, seed)
        reached = along(cost, shortest_order(cost))
        assert reached < 0.8 * along(cost, np.arange(n))


def test_one_place_and_none() -> None:
    for n in (0, 1):
        assert shortest_order(np.zeros((n, n))).tolist() == list(range(n))
