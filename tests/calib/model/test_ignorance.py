"""What values that were not estimated add to the expected error: the same answer everywhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.cell.targets import targets_of
from calib.compensation.estimate import estimate_of
from calib.model.covariance import accuracy, covariance, errors_at, ignorance
from doe.ahead.enough import enough
from studies.demo.embedded import embedded_plan, simulated
from tests.doe.ahead.day import cell_of_day, whole_day
from tests.helpers import with_effects

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
