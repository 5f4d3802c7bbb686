"""What columns would explain, and from which size on they are seen, on plain linear problems."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import Array
from calib.diagnosis.detection_limit import detectable, entry_limit
from calib.inference.evidence import score_test, visible_directions, weighted_test

N, X = np.split(np.random.default_rng(0).normal(size=(300, 13)), [8], axis=1)


def beside(columns: Array) -> Array:
    return np.asarray(columns - N @ np.linalg.lstsq(N, columns, rcond=None)[0])


def test_the_score_is_the_fall_of_the_sum_of_squares(rng: np.random.Generator) -> None:
    r, left = rng.normal(size=300), beside(X)
    fall, k = score_test(left.T @ left, left.T @ r, np.linalg.norm(X, axis=0))
    both = np.column_stack([N, X])
    together = r - both @ np.linalg.lstsq(both, r, rcond=None)[0]
    alone = beside(r)
    assert fall == pytest.approx(alone @ alone - together @ together)
    assert k == 5


def test_what_the_model_contains_is_invisible(rng: np.random.Generator) -> None:
    inside = N @ rng.normal(size=(8, 2))
    left, lengths = beside(inside), np.linalg.norm(inside, axis=0)
    fall, k = score_test(left.T @ left, left.T @ rng.normal(size=300), lengths)
    assert (fall, k) == (0.0, 0)
    assert not visible_directions(left.T @ left, lengths)[1].any()
    assert np.isinf(detectable(left.T @ left, lengths, 10, 0.01).smallest).all()


@pytest.mark.parametrize("k", [1, 4])
def test_an_effect_of_the_size_said_to_be_detectable_is_detected(
    k: int, rng: np.random.Generator
) -> None:
    own, choices = beside(X[:, :k]), 200.0
    S, lengths = own.T @ own, np.linalg.norm(X[:, :k], axis=0)
    found = detectable(S, lengths, choices, 0.01)
    draws = rng.normal(size=(300, 300)) + own[:, :1] * found.smallest[0]
    falls = np.array([float(score_test(S, own.T @ r, lengths)[0]) for r in draws.T])
    assert np.mean(falls > entry_limit(k, choices, 0.01)) == pytest.approx(0.9, abs=0.06)


def test_a_score_at_the_entry_limit_pays_for_its_choice() -> None:
    """At the amplitude that is best where all directions show alike, by a fine grid of these."""
    for k in (1, 3, 6):
        limit, squared = entry_limit(k, 500.0, 1.0), np.geomspace(1e-3, 1e4, 4000)
        gains = squared * limit / (1.0 + squared) - k * np.log1p(squared)
        assert gains.max() == pytest.approx(2.0 * np.log(500.0), rel=1e-3)


@pytest.mark.parametrize("freedom", [np.inf, 290.0])
def test_a_weighted_test_comes_by_chance_as_often_as_it_says(
    freedom: float, rng: np.random.Generator
) -> None:
    left, lengths = beside(X[:, :3]), np.linalg.norm(X[:, :3], axis=0)
    spread = np.diag([1.0, 0.1, 0.01])
    found = []
    for _ in range(400):
        r = rng.normal(size=300)
        found.append(weighted_test(left.T @ left, left.T @ r, lengths, spread, freedom)[0])
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.045)
