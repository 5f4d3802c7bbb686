"""Covariances in a span: what they say of single values, and what was not estimated adds to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.arrays import Array
from calib.cell.targets import targets_of
from calib.model.covariance import (
    accuracy,
    covariance,
    determined,
    errors_at,
    ignorance,
)
from calib.prediction.estimate import estimate_of
from calib.solver import condensed, inverse_factor, levenberg_marquardt
from doe.forecast.enough import enough
from studies.demo.embedded import embedded_plan
from tests.doe.forecast.day import cell_of_day, whole_day
from tests.helpers import simulated, with_effects

OPEN = ("gravity_compensator:A2", "gravity_sag:A2", "link_weight:A2")


def test_it_is_the_bayesian_covariance_with_a_prior_on_what_was_lost() -> None:
    """Two of six columns are sums of others; J^T J + 1 / size^2 is inverted as it stands."""
    rng = np.random.default_rng(0)
    J = rng.normal(size=(30, 6))
    J[:, 4:] = J[:, :4] @ rng.normal(size=(4, 2))
    sizes = np.array([1.0, 0.3, 1e-3, 20.0, 5.0, 1e-2])
    lost = np.arange(6) >= 4
    span = np.eye(6)[:, ~lost]
    total = covariance(J, span) + ignorance(J, span, sizes, lost)
    honest = np.linalg.inv(J.T @ J + np.diag(lost / sizes**2))
    np.testing.assert_allclose(total, honest, rtol=1e-8, atol=1e-12)
    # With a prior on every value, as that of a designer, less is open: never more.
    with_all = np.linalg.inv(J.T @ J + np.diag(1.0 / sizes**2))
    scaled = (total - with_all) / np.outer(sizes, sizes)
    assert np.linalg.eigvalsh(scaled).min() > -1e-9
    # What was measured is predicted as well as if nothing were lost.
    np.testing.assert_allclose(J @ total @ J.T, J @ covariance(J, span) @ J.T, atol=1e-9)


def test_a_value_that_shows_nowhere_keeps_its_size() -> None:
    J = np.column_stack([np.ones(5), np.zeros(5)])
    lost = np.array([False, True])
    np.testing.assert_array_equal(
        ignorance(J, np.eye(2)[:, :1], np.array([1.0, 3.0]), lost), np.diag([0.0, 9.0])
    )


@pytest.fixture(scope="module")
def elastic(kr270: Cell) -> Cell:
    return with_effects(cell_of_day(kr270), *cell_of_day(kr270).effects, *OPEN)


@pytest.mark.parametrize(("sizes", "rel"), [("off", 1e-6), ("estimated", 1e-4)])
def test_identify_compensate_and_enough_expect_the_same(
    elastic: Cell, table_two: Poses, sizes: Literal["off", "estimated"], rel: float
) -> None:
    """Beside sizes of the others the forecast estimates what identify leaves where it was."""
    elastic = replace(elastic, size_prior=sizes)
    data = whole_day(elastic, table_two)
    result = calib.identify(elastic, data)
    assert result.unidentifiable
    told = accuracy(result.model, result.values, result.knowledge, *targets_of(elastic))
    known = estimate_of(result)
    np.testing.assert_array_equal(known.covariance, result.knowledge)
    now = enough(elastic, data).steps[0]
    assert (now.task_rms, now.task_worst) == pytest.approx(told, rel=rel)


def test_poses_that_were_measured_are_known_whatever_was_lost(kr270: Cell) -> None:
    cell = with_effects(kr270, *kr270.effects, *OPEN)
    data, _, _ = simulated(kr270, embedded_plan(kr270), 0)
    result = calib.identify(cell, data)
    assert result.unidentifiable
    poses = data.poses.take(~result.fit.outlier)
    alone = errors_at(result.model, result.values, result.covariance, poses)
    told = errors_at(result.model, result.values, result.knowledge, poses)
    np.testing.assert_allclose(told, alone, rtol=0.05)


def test_values_whose_direction_is_in_the_span_are_determined(rng: np.random.Generator) -> None:
    eye = np.eye(5)
    span = np.column_stack([eye[0], eye[2], (eye[3] + eye[4]) / np.sqrt(2.0)])
    assert list(determined(span)) == [True, False, True, False, False]
    mixed = span @ rng.normal(size=(3, 3))  # another basis of the same span
    assert list(determined(mixed)) == [True, False, True, False, False]
    assert determined(rng.normal(size=(5, 5))).all()
    assert not determined(np.zeros((5, 0))).any()


def test_a_direction_that_moves_nothing_has_no_deviation() -> None:
    J = np.column_stack([np.random.default_rng(0).normal(size=(12, 2)), np.zeros(12)])
    found = covariance(J, np.eye(3))
    np.testing.assert_allclose(found[:2, :2], np.linalg.inv(J[:, :2].T @ J[:, :2]))
    assert not found[2].any()
    lost = np.array([False, False, True])
    assert np.isfinite(ignorance(J, np.eye(3), np.ones(3), lost)).all()


@pytest.mark.parametrize("wrong", [0.0, -1.0])
@pytest.mark.parametrize("count", [5, 80])
def test_one_matrix_that_is_not_positive_definite_is_refused(count: int, wrong: float) -> None:
    V = np.repeat(np.eye(4)[None], count, axis=0)
    V[3, 2, 2] = wrong
    with pytest.raises(np.linalg.LinAlgError):
        inverse_factor(V)


def test_a_covariance_singular_by_rounding_has_a_factor() -> None:
    """A level of noise beyond all others leaves the small ones below rounding."""
    H = np.random.default_rng(0).normal(size=(3, 20, 4))
    V = 1e17 * H @ np.swapaxes(H, -1, -2) + np.eye(20)
    for some in (V, V[:, :6, :6].repeat(30, axis=0)):
        assert np.isfinite(inverse_factor(some)).all()


def test_the_solver_does_not_call_a_dead_end_a_minimum() -> None:
    def wrong_way(v: Array) -> tuple[Array, Array]:
        return 1.0 - v, -np.eye(1)

    found = levenberg_marquardt(wrong_way, np.zeros(1), np.eye(1))
    assert not found.converged

    def nothing(v: Array) -> tuple[Array, Array]:
        return np.full(1, np.nan), np.eye(1)

    assert not levenberg_marquardt(nothing, np.zeros(1), np.eye(1)).converged


@pytest.mark.parametrize("shape", [(9, 12), (300, 12), (40_000, 12), (700, 130)])
def test_condensed_columns_have_the_same_products(shape: tuple[int, int]) -> None:
    """The last of them nearly the sum of the others, which squares would not show."""
    A = np.random.default_rng(1).normal(size=shape)
    A[:, -1] = A[:, :-1].sum(axis=1) + 1e-9 * A[:, -1]
    found = condensed(A)
    assert len(found) <= shape[1]
    np.testing.assert_allclose(found.T @ found, A.T @ A, rtol=1e-9, atol=1e-9 * shape[0])
    apart = np.append(-np.ones(shape[1] - 1), 1.0)
    np.testing.assert_allclose(np.linalg.norm(found @ apart), np.linalg.norm(A @ apart), rtol=1e-4)
