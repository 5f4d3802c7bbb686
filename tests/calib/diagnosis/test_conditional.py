"""What candidates are worth beside others, against the likelihood of the whole set, entry by entry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from calib.diagnosis.compressed import Block, CompressedColumns
from calib.diagnosis.conditional import Conditional, Curvature
from calib.inference import Design, GaussianBlock, RandomEffect
from calib.inference.restricted import RestrictedLikelihood

POSES, ROWS = 40, 9
THETA = np.array([0.7, 0.3, 0.2, 0.5, 0.1, 0.4, 0.2])


@pytest.fixture(scope="module")
def columns() -> CompressedColumns:
    """Twenty configurations read twice, three joints that scatter, seven columns of candidates."""
    rng = np.random.default_rng(0)

    def rows(k: int) -> Any:
        return rng.normal(size=(POSES, ROWS, k))

    groups = {"configuration": np.repeat(np.arange(POSES // 2), 2), "approach": np.arange(POSES)}
    levers = [rows(1) for _ in range(3)]
    effects = tuple(
        RandomEffect(f"{name}:{k}", own, "joint", group)
        for name, group in groups.items()
        for k, own in enumerate(levers)
    )
    known = GaussianBlock("known", rows(2), np.eye(2), np.zeros(2), 1.0)
    present = np.zeros((POSES, ROWS), dtype=int)
    design = Design(rows(1)[..., 0], rows(5), np.eye(5), (known,), effects, present)
    return CompressedColumns.of(design).with_columns(rows(7))


def block(columns: CompressedColumns, first: int, count: int, size: float) -> Block:
    """Some of the candidates' columns."""
    start = columns.response + 1 + first
    return np.arange(start, start + count), size


def whole(columns: CompressedColumns, *blocks: Block) -> tuple[float, Array]:
    """-2 log likelihood, and its gradient by log variances."""
    found = RestrictedLikelihood(columns.model(blocks), THETA)
    return found.value, found.derivatives[0]


def worth(beside: Conditional, own: Block) -> tuple[float, Array]:
    """Gain and change of the gradient by closed formulas."""
    asked, size = own[0][None], np.array([own[1]])
    return float(beside.gains(asked, size[None])[0][0]), beside.changes(asked, size)[0]


def test_a_newcomer_gains_what_the_likelihood_says(columns: CompressedColumns) -> None:
    rest, new = [block(columns, 0, 2, 2.0), block(columns, 2, 1, 0.5)], block(columns, 3, 3, 1.3)
    gain, change = worth(Conditional.of(columns.at(THETA), rest), new)
    before, after = whole(columns, *rest), whole(columns, *rest, new)
    assert gain == pytest.approx(before[0] - after[0], abs=1e-9)
    np.testing.assert_allclose(change, after[1] - before[1], atol=1e-9)


def test_a_member_and_its_rivals_are_judged_beside_the_others(columns: CompressedColumns) -> None:
    member, other, rival = (
        block(columns, 0, 2, 2.0),
        block(columns, 2, 1, 0.5),
        block(columns, 3, 3, 1.3),
    )
    beside = Conditional.of(columns.at(THETA), [member, other]).without(member[0])
    nothing = whole(columns, other)
    for own in (member, rival):
        gain, change = worth(beside, own)
        there = whole(columns, own, other)
        assert gain == pytest.approx(nothing[0] - there[0], abs=1e-9)
        np.testing.assert_allclose(change, there[1] - nothing[1], atol=1e-9)


def test_a_second_newcomer_is_judged_beside_the_first(columns: CompressedColumns) -> None:
    rest, first, second = (
        block(columns, 2, 1, 0.5),
        block(columns, 3, 3, 1.3),
        block(columns, 0, 2, 2.0),
    )
    beside = Conditional.of(columns.at(THETA), [rest]).adding(*first)
    gain = float(beside.gains(second[0][None], np.array([[second[1]]]))[0][0])
    expected = whole(columns, rest, first)[0] - whole(columns, rest, first, second)[0]
    assert gain == pytest.approx(expected, abs=1e-9)


def test_the_best_of_several_amplitudes_counts(columns: CompressedColumns) -> None:
    own = block(columns, 3, 3, 1.0)[0]
    beside = Conditional.of(columns.at(THETA), [])
    sizes = np.array([0.01, 0.1, 1.0, 10.0])
    gain, size = beside.gains(own[None], sizes[None])
    each = [whole(columns)[0] - whole(columns, (own, float(a)))[0] for a in sizes]
    assert gain[0] == pytest.approx(max(each), abs=1e-9)
    assert size[0] == sizes[int(np.argmax(each))]


def test_a_newton_step_promises_less_than_a_search_finds() -> None:
    """One variance of n rows whose mean square falls to a share q: n (q - 1 - log q) in truth."""
    n = 50.0
    free = np.array([True])
    for q in (0.9, 0.5, 0.1):
        curvature = Curvature(np.zeros(1), np.array([[n]]), free)
        promised = float(curvature.promised(np.array([[n * (1.0 - q)]]))[0])
        assert 0.0 < promised <= n * (q - 1.0 - np.log(q))
    held = Curvature(np.zeros(1), np.array([[n]]), ~free)
    assert held.promised(np.array([[n]]))[0] == 0.0
