"""The linear oracle against plain enumeration."""

from __future__ import annotations

import numpy as np
import pytest

from tests.doe.problems import grouped, plans

RULES = {
    "one group": grouped(9, 1, 4),
    "levels": grouped(9, 3, 2),
    "repeats": grouped(6, 2, 3, repeats=True),
    "levels to choose": grouped(10, 5, 2, used=2),
    "apart": grouped(12, 6, 1, used=3, separation=2.0),
    "apart, repeats": grouped(12, 6, 2, used=2, separation=3.0, repeats=True),
}


@pytest.mark.parametrize("name", RULES)
def test_best_and_forced(name: str) -> None:
    allowed = RULES[name]
    rng = np.random.default_rng(1)
    every = plans(allowed)
    for _ in range(20):
        scores = rng.uniform(0.0, 1.0, len(allowed.group))
        sums = np.array([scores[plan].sum() for plan in every])
        value, plan = allowed.best(scores)
        assert value == pytest.approx(sums.max(), rel=1e-12)
        assert scores[plan].sum() == pytest.approx(value, rel=1e-12)
        assert any(np.array_equal(np.sort(plan), np.sort(other)) for other in every)
        forced = allowed.forced(scores)
        for j in range(len(scores)):
            with_it = max(
                (s for s, other in zip(sums, every, strict=True) if j in other), default=-np.inf
            )
            assert forced[j] >= with_it - 1e-12
        if not allowed.chooses_levels:
            assert forced.max() == pytest.approx(value, rel=1e-12)


def test_what_is_no_plan() -> None:
    allowed = grouped(12, 6, 2, used=2, separation=2.0)
    assert allowed.admits(np.array([0, 6, 2, 8]))
    assert not allowed.admits(np.array([0, 6, 1, 7]))  # too close
    assert not allowed.admits(np.array([0, 6, 0, 6]))  # one level, twice
    assert not allowed.admits(np.array([0, 2, 4, 8]))  # three levels
    assert not allowed.admits(np.array([0, 0, 2, 8]))  # a candidate twice


def test_levels_without_enough_candidates_are_not_used() -> None:
    allowed = grouped(7, 4, 2, used=3)  # the last level has one candidate only
    value, plan = allowed.best(np.r_[np.zeros(3), 10.0, np.zeros(3)])
    assert value == 0.0
    assert 3 not in allowed.group[plan]
