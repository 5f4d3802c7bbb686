"""Restricted likelihood and decorrelation against dense matrices."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array, IntArray
from calib.errors import Unsolvable
from calib.inference import Design
from calib.inference.decorrelation import Groups, InverseRoot
from calib.inference.restricted import MixedModel, RestrictedLikelihood
from tests.calib.designs import (
    GROUPS,
    ROWS,
    Dense,
    random_design,
    random_theta,
    simple_design,
)


def of(design: Design, theta: Array) -> RestrictedLikelihood:
    return RestrictedLikelihood(MixedModel.of(design), theta)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("groups", list(GROUPS))
def test_value_gradient_and_information_are_those_of_dense_matrices(groups: str, seed: int) -> None:
    design = random_design(groups, seed)
    theta = random_theta(design, seed)
    found, dense = of(design, theta), Dense(design, theta)
    gradient, information = found.derivatives
    assert found.value == pytest.approx(dense.value, rel=1e-11)
    np.testing.assert_allclose(gradient, dense.gradient, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(information, dense.information, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("groups", list(GROUPS))
def test_products_with_the_inverse_covariance_are_those_of_dense_matrices(groups: str) -> None:
    """Woodbury, cell by cell and component by component."""
    design = random_design(groups)
    theta = random_theta(design)
    found = of(design, theta)
    turned, own = found.model.turned, found.decorrelation
    unit = np.eye(len(design.live))
    inside = turned.inside(unit)
    left = (unit - turned.spread(inside)) / theta[design.instrument][:, None]
    blocks = replace(design, blocks=())
    V = Dense(blocks, theta[:-1]).V
    expected = np.linalg.inv(V)
    inverse = left + turned.spread(own.back(own(inside)))
    np.testing.assert_allclose(inverse, expected, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("variance", range(2, 6))
def test_a_variance_of_zero_is_no_effect(variance: int) -> None:
    """Value as without it, and no slope of its logarithm."""
    design = random_design()
    theta = random_theta(design)
    theta[variance] = 0.0
    found, dense = of(design, theta), Dense(design, theta)
    gradient, information = found.derivatives
    assert found.value == pytest.approx(dense.value, rel=1e-11)
    assert gradient[variance] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(information[variance], 0.0, atol=1e-12)


def test_order_of_poses_and_rows_changes_nothing() -> None:
    design = random_design()
    theta = random_theta(design)
    rng = np.random.default_rng(9)
    poses, rows = rng.permutation(len(design.r)), rng.permutation(ROWS)

    def moved(a: Array) -> Array:
        return a[poses][:, rows]

    shuffled = replace(
        design,
        r=moved(design.r),
        J=moved(design.J),
        blocks=tuple(replace(b, columns=moved(b.columns)) for b in design.blocks),
        effects=tuple(
            replace(e, levers=moved(e.levers), group=100 - 7 * e.group[poses])
            for e in design.effects
        ),
        instrument_of_row=moved(design.instrument_of_row),
    )
    one, other = of(design, theta), of(shuffled, theta)
    assert one.value == pytest.approx(other.value, rel=1e-12)
    np.testing.assert_allclose(one.derivatives[1], other.derivatives[1], rtol=1e-9, atol=1e-11)


def test_dependent_columns_leave_a_likelihood() -> None:
    design = random_design()
    twice = np.concatenate([design.J, design.J[..., :1] + design.J[..., 1:2]], axis=-1)
    other = replace(design, J=twice, span=np.eye(4))
    theta = random_theta(design)
    assert other.directions.shape == (4, 3)
    np.testing.assert_allclose(
        of(other, theta).derivatives[0], of(design, theta).derivatives[0], rtol=1e-8, atol=1e-9
    )


def test_groups_that_cross_are_refused() -> None:
    design = random_design()
    across = replace(design.effects[0], group=np.arange(len(design.r)) % 2)
    with pytest.raises(ValueError, match="nested"):
        MixedModel.of(replace(design, effects=(*design.effects, across)))


def test_numbers_that_are_none_are_refused() -> None:
    design = random_design()
    r = design.r.copy()
    r[0, 0] = np.nan
    with pytest.raises(Unsolvable):
        MixedModel.of(replace(design, r=r))


@pytest.mark.parametrize("approaches", [1, 400])
def test_many_poses_of_one_place_make_no_square(approaches: int) -> None:
    """Cells keep as few rows as levers have rank; cost grows as poses or as approaches do."""
    rng, poses, rows = np.random.default_rng(0), 4000, 6
    design = simple_design(
        np.broadcast_to(rng.normal(size=(rows, 3)), (poses, rows, 3)),
        np.arange(poses) * approaches // poses,
        rng.normal(size=(poses, rows, 2)),
        rng.normal(size=(poses, rows)),
    )
    place = replace(design.effects[0], name="place", group=np.zeros(poses, dtype=int))
    design = replace(design, effects=(*design.effects, place))
    tracemalloc.start()
    found = of(design, np.ones(3))
    found.derivatives  # noqa: B018
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.model.inside.shape == (approaches, 3, 3)
    assert found.model.turned.outside.tolist() == [poses * rows - 3 * approaches]
    assert peak < 60 * poses * rows * 8


@pytest.mark.parametrize("groups", list(GROUPS))
def test_turned_rows_and_the_rest_keep_all_products(groups: str) -> None:
    """And the rest is as many rows as the turn says, of all instruments together."""
    design = random_design(groups)
    turned, rows = MixedModel.of(design).turned, design.columns
    inside, outside = turned.inside(rows).reshape(-1, rows.shape[1]), turned.outside_rows(rows)
    np.testing.assert_allclose(inside.T @ inside + outside.T @ outside, rows.T @ rows, atol=1e-10)
    assert np.count_nonzero(outside.any(axis=1)) == turned.outside.sum()


M = 12


ALONE, PAIRS, PLACES = np.arange(M), np.arange(M) // 2, np.arange(M)[::-1] // 4


LEVELS: dict[str, tuple[tuple[IntArray, int], ...]] = {
    "none": (),
    "poses": ((ALONE, 3),),
    "groups": ((PLACES, 3),),
    "poses, then groups": ((ALONE, 3), (PLACES, 2)),
    "groups, then groups": ((PAIRS, 9), (PLACES, 2)),
}


def dense(levels: tuple[tuple[IntArray, int], ...], K: list[Array], scale: float) -> Array:
    """Covariance of all rows, entry by entry."""
    rows = K[0].shape[1] if K else 5
    V = np.eye(M * rows)
    for (group, _), levers in zip(levels, K, strict=True):
        flat, of_row = levers.reshape(M * rows, -1), np.repeat(group, rows)
        V += (flat @ flat.T) * (of_row[:, None] == of_row)
    return np.asarray(scale**2 * V)


@pytest.mark.parametrize("rows", [1, 5, 40])
@pytest.mark.parametrize("name", list(LEVELS))
def test_a_root_is_that_of_dense_matrices(name: str, rows: int) -> None:
    """The map, its transpose, the inverse in parts, and covariances."""
    rng, levels, scale = np.random.default_rng(rows), LEVELS[name], 1.7
    K = [rng.normal(size=(M, rows, k)) * 3.0 for _, k in levels]
    of = [(Groups.of(group), levers) for (group, _), levers in zip(levels, K, strict=True)]
    root, size = InverseRoot.of(scale, of), M * rows
    V, unit = dense(levels, K, scale) if K else scale**2 * np.eye(size), np.eye(size)
    W = root(unit.reshape(M, rows, size)).reshape(size, size)
    np.testing.assert_allclose(W @ V @ W.T, unit, atol=1e-9)
    np.testing.assert_allclose(root.back(unit.reshape(M, rows, size)).reshape(size, size), W.T)
    inverse = unit.copy()
    for groups, G in root.shared:
        flat, of_row = G.reshape(size, -1), np.repeat(groups.number, rows)
        inverse -= (flat @ flat.T) * (of_row[:, None] == of_row)
    np.testing.assert_allclose(inverse / scale**2, np.linalg.inv(V), atol=1e-9)
    gains = rng.normal(size=(M, rows, 3))
    flat = gains.reshape(size, 3)
    np.testing.assert_allclose(root.covariance(gains), flat.T @ V @ flat, rtol=1e-9)
