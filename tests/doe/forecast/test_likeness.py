"""Information and look-alikes on plain linear problems, against least squares and simulated choices."""

from __future__ import annotations

import numpy as np
import pytest

from calib.arrays import Array
from calib.inference.evidence import visible_directions
from doe.forecast.accuracy import most_useful_first
from doe.forecast.likeness import SURE, likeness, plausible
from doe.information import TargetErrors

ROWS = 400
RNG = np.random.default_rng(3)
N = RNG.normal(size=(ROWS, 6))
FIRST = RNG.normal(size=ROWS)
X = np.column_stack(
    [
        FIRST,  # 0
        0.95 * FIRST + 0.3 * RNG.normal(size=ROWS),  # 1: much like it
        -3.0 * FIRST + N @ RNG.normal(size=6),  # 2: its twin, once N is projected out
        *RNG.normal(size=(2, ROWS)),  # 3, 4
    ]
)
CAUSES = [np.array([0]), np.array([1]), np.array([2]), np.array([0, 3, 4]), np.array([1, 4])]
DRAWS = [plausible(np.ones(len(own))) for own in CAUSES]


def gram(columns: Array) -> Array:
    """Products of columns with N projected out, by plain least squares."""
    left = columns - N @ np.linalg.lstsq(N, columns, rcond=None)[0]
    return np.asarray(left.T @ left)


ALIKE = likeness(gram(X), np.linalg.norm(X, axis=0), CAUSES, DRAWS)


def directions(left: Array, columns: Array) -> Array:
    T, seen = visible_directions(left.T @ left, np.linalg.norm(columns, axis=0))
    return np.asarray(left @ T[:, seen])


def simulated(e: int, f: int, noncentrality: float, trials: int = 4000) -> float:
    """Share of trials in which cause e, which is there, has the better score less its price."""
    rng = np.random.default_rng(e + 10 * f)
    left = X - N @ np.linalg.lstsq(N, X, rcond=None)[0]
    own, other = (directions(left[:, c], X[:, c]) for c in (CAUSES[e], CAUSES[f]))
    signal = left[:, CAUSES[e]] @ rng.normal(size=(len(CAUSES[e]), trials))
    signal *= np.sqrt(noncentrality) / np.linalg.norm(signal, axis=0)
    r = signal + rng.normal(size=signal.shape)

    def gain(U: Array) -> Array:
        return np.asarray(((U.T @ r) ** 2).sum(axis=0) - U.shape[1] * np.log(ROWS))

    return float(np.mean(gain(own) > gain(other)))


@pytest.mark.parametrize(("e", "f"), [(0, 1), (1, 0), (3, 4), (4, 3), (3, 1), (0, 3)])
@pytest.mark.parametrize("noncentrality", [30.0, 80.0])
def test_preference_is_that_of_simulated_choices(e: int, f: int, noncentrality: float) -> None:
    expected = ALIKE.preferred(np.full(len(CAUSES), noncentrality), ROWS)[e, f]
    assert simulated(e, f, noncentrality) == pytest.approx(expected, abs=0.03)


def test_what_is_left_is_that_of_least_squares() -> None:
    for e, f in ((0, 1), (1, 3), (0, 4)):
        signal = X[:, CAUSES[e]].sum(axis=1)
        both = np.column_stack([N, X[:, CAUSES[f]]])
        beside = signal - both @ np.linalg.lstsq(both, signal, rcond=None)[0]
        alone = signal - N @ np.linalg.lstsq(N, signal, rcond=None)[0]
        left = (beside @ beside) / (alone @ alone)
        (alone_left,) = likeness(
            gram(X), np.linalg.norm(X, axis=0), CAUSES, [np.ones((len(own), 1)) for own in CAUSES]
        ).left[e, f]
        assert alone_left == pytest.approx(left, rel=1e-9)
        if len(CAUSES[e]) == 1:
            np.testing.assert_allclose(ALIKE.left[e, f], left, rtol=1e-9)


def test_the_needed_size_is_told_apart_and_no_less() -> None:
    needed = ALIKE.needed(ROWS)
    for e, f in ((0, 1), (3, 4), (3, 1)):
        chance = ALIKE.preferred(np.where(np.isfinite(needed), needed, 1.0), ROWS)[e, f]
        assert chance == pytest.approx(SURE, abs=1e-6)
        assert simulated(e, f, float(needed[e, f])) == pytest.approx(SURE, abs=0.02)


def test_confounded_causes_are_never_told_apart() -> None:
    assert [tuple(np.flatnonzero(row)) for row in ALIKE.confounded[[0, 2]]] == [(0, 2), (0, 2)]
    assert not ALIKE.confounded[0, 1]
    needed = ALIKE.needed(ROWS)
    assert needed[0, 2] == needed[2, 0] == np.inf
    assert ALIKE.preferred(np.full(len(CAUSES), 1e4), ROWS)[0, 2] == pytest.approx(0.5)


def test_a_part_of_a_rival_is_told_from_it_by_its_price() -> None:
    """Cause 0 is one direction of cause 3: it costs less for the same, at any size."""
    assert ALIKE.needed(ROWS)[0, 3] == 0.0
    assert 0.0 < ALIKE.needed(ROWS)[3, 0] < np.inf


def test_the_most_useful_pose_is_that_of_all_rows_at_once() -> None:
    rng = np.random.default_rng(0)
    p, sizes, weights = 6, rng.uniform(0.5, 2.0, 6), rng.uniform(size=5)
    at = TargetErrors(rng.normal(size=(5, 3, p)), weights / weights.sum())
    own, more = rng.normal(size=(30, p)) / sizes, rng.normal(size=(4, 9, p)) / sizes

    def direct(*further: int) -> float:
        rows = np.concatenate([own, *(more[i] for i in further)]) * sizes
        cov = np.linalg.inv(rows.T @ rows + np.eye(p) / 100.0)
        return float(at.weights @ np.einsum("krp,pq,krq->k", at.rows, cov, at.rows))

    first, second, *_ = most_useful_first(at, own, more, sizes)
    assert first == np.argmin([direct(i) for i in range(4)])
    assert second == min(set(range(4)) - {first}, key=lambda i: direct(first, i))
