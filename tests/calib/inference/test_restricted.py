"""Restricted likelihood: value, gradient and information against dense matrices."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from calib.arrays import Array
from calib.errors import Unsolvable
from calib.inference import Design
from calib.inference.restricted import MixedModel, RestrictedLikelihood
from tests.calib.inference.designs import (
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


def test_units_shift_the_value_by_a_constant_alone() -> None:
    """Rows in mm, b in mm, effects in mrad: gradient and information by logarithms are the same."""
    design = random_design()
    theta = random_theta(design)
    other = replace(
        design,
        r=1e3 * design.r,
        J=design.J * np.array([1.0, 1e3, 1e6]),
        blocks=tuple(replace(b, columns=1e3 * b.columns) for b in design.blocks),
        effects=tuple(replace(e, levers=1e-3 * 1e3 * e.levers) for e in design.effects),
    )
    scaled = theta.copy()
    scaled[:2] *= 1e6
    scaled[2:5] *= 1e6
    one, two = of(design, theta), of(other, scaled)
    for a, b in zip(one.derivatives, two.derivatives, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)


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


def test_work_grows_as_groups_and_not_as_their_square() -> None:
    """Arrays of a likelihood by their shapes: twice the poses hold twice the numbers."""

    def numbers(places: int) -> int:
        rng, m = np.random.default_rng(0), 2 * places
        levers = rng.normal(size=(m, 9, 6))
        design = simple_design(
            levers, np.arange(m), rng.normal(size=(m, 9, 4)), rng.normal(size=(m, 9))
        )
        place = replace(design.effects[0], group=np.arange(m) // 2)
        found = of(replace(design, effects=(*design.effects, place)), np.ones(3))
        found.derivatives  # noqa: B018
        own = found.decorrelation
        held = [own.cells.T, own.components.K, own.components.root, found.inside, found.weighted]
        held += [own.inverse, found.model.turned.outer, found.orthonormal]
        return sum(a.size for a in held)

    assert numbers(80) == 2 * numbers(40)


@pytest.mark.parametrize("groups", list(GROUPS))
def test_turned_rows_and_the_rest_keep_all_products(groups: str) -> None:
    """And the rest is as many rows as the turn says, of all instruments together."""
    design = random_design(groups)
    turned, rows = MixedModel.of(design).turned, design.columns
    inside, outside = turned.inside(rows).reshape(-1, rows.shape[1]), turned.outside_rows(rows)
    np.testing.assert_allclose(inside.T @ inside + outside.T @ outside, rows.T @ rows, atol=1e-10)
    assert np.count_nonzero(outside.any(axis=1)) == turned.outside.sum()
