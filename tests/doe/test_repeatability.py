"""Plans for an arm that comes to a pose otherwise each time."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell, readings
from calib.arm.se3 import skew
from calib.arrays import Array
from calib.cell import Load, Repeatability
from calib.cell.planned import Planned
from calib.model import Model
from calib.poses import poses_at
from doe.information import Regressor
from doe.problem import problem_of
from doe.request import Request
from studies.compare.experiment import POINTS, experiment_of, predict
from studies.results.compare import compared
from tests.doe.plans import unpolished, visiting_again
from tests.helpers import cell_of, random_robot, with_effects

ARM = Repeatability(3e-5, 5e-5)
QUICK: dict[str, Any] = {"candidates": 300}


@pytest.fixture(scope="module")
def rigid(kr270: Cell) -> Cell:
    effects = ("base", "joint_offset", "joint_compliance:A2,A3")
    return replace(with_effects(kr270, *effects), load=None, design=Planned())


def some_markers(cell: Cell, count: int) -> Cell:
    """The cell with so many markers, nothing known of where they face."""
    markers = np.random.default_rng(5).uniform(-0.25, 0.25, (6, 3))[:count]
    blank = np.full((count, 3), np.nan)
    names = tuple(f"m{k}" for k in range(count))
    return replace(
        cell,
        markers=markers,
        marker_names=names,
        marker_normals=blank,
        marker_acceptance=blank[:, 0],
    )


def covariance_of(cell: Cell, model: Model, q: Array, arm: Repeatability, seen: Array) -> Array:
    """Of the readings of one visit, marker by marker, by the geometry of a rigid tip alone."""
    poses = readings(cell, poses_at(q[None]))
    frames = model.state(np.zeros(len(model.parameters)), poses.take([0])).frames
    arms = cell.markers[seen] @ frames.R[0, -1].T
    one = np.concatenate([np.hstack([np.eye(3), -skew(a)]) for a in arms])
    H = np.tile(one, (len(poses), 1))
    U = np.repeat([arm.translation, arm.rotation], 3) ** 2
    return np.asarray(np.eye(len(H)) * cell.noise.along**2 + (H * U) @ H.T)


@pytest.mark.parametrize("loaded", [False, True], ids=["free", "free and loaded"])
def test_information_is_that_of_readings_which_err_together(kr270: Cell, loaded: bool) -> None:
    """Against the observation matrix and the dense covariance of a visit, a marker hidden."""
    cell = with_effects(kr270, "base", "joint_offset", "joint_compliance:A2,A3")
    cell = replace(cell, repeatability=ARM, load=cell.load if loaded else None, design=Planned())
    problem = problem_of(cell, Request(poses=8, criterion="D"))
    rng = np.random.default_rng(2)
    q = rng.uniform(*cell.robot.sample_limits().T, (4, 6))
    visible = np.array([[True] * 3, [True, False, True], [False, True, True], [True] * 3])
    found = problem.regressor.information(q, visible)
    back = np.linalg.inv(problem.regressor.T)
    B = calib.observation(cell, q).reshape(4, -1, 3, 3, len(back))
    for own, seen, rows, M in zip(q, visible, B, found, strict=True):
        V = covariance_of(cell, problem.model, own, ARM, seen)
        J = rows[:, seen].reshape(len(V), -1)
        expected = J.T @ np.linalg.solve(V, J)
        np.testing.assert_allclose(
            back.T @ M @ back, expected, rtol=1e-8, atol=1e-9 * expected.max()
        )


def test_readings_without_the_model_still_tell_of_the_approach(kr270: Cell) -> None:
    """Known geometry, no weights: free readings hold nothing but what the approach was off by."""
    cell = with_effects(kr270, "joint_compliance:A2,A3,A4,A5,A6")
    robot = replace(cell.robot, masses=np.zeros(6))
    cell = replace(cell, robot=robot, repeatability=ARM, design=Planned())
    problem = problem_of(cell, Request(poses=6, criterion="D"))
    q = np.random.default_rng(3).uniform(*robot.sample_limits().T, (2, 6))
    seen = np.ones(3, dtype=bool)
    back = np.linalg.inv(problem.regressor.T)
    still = replace(cell, repeatability=None)
    alone = Regressor.nominal(still, problem.model, problem.regressor.values)
    alone = replace(alone, T=problem.regressor.T).information(q)
    for own, rows, M, ideal in zip(
        q, calib.observation(cell, q), problem.regressor.information(q), alone, strict=True
    ):
        V = covariance_of(cell, problem.model, own, ARM, seen)
        expected = rows.T @ np.linalg.solve(V, rows)
        np.testing.assert_allclose(
            back.T @ M @ back, expected, rtol=1e-8, atol=1e-9 * expected.max()
        )
        assert np.trace(M) < np.trace(ideal)


@pytest.mark.long
def test_none_changes_nothing(rigid: Cell) -> None:
    plain = unpolished(rigid, poses=12, **QUICK)
    still = unpolished(replace(rigid, repeatability=Repeatability(0.0, 0.0)), poses=12, **QUICK)
    np.testing.assert_array_equal(plain.poses.q, still.poses.q)
    assert (plain.value, plain.bound) == (still.value, still.bound)
    np.testing.assert_array_equal(plain.assessment.std, still.assessment.std)


@pytest.mark.long
def test_more_markers_stop_paying_and_more_poses_pay(rigid: Cell) -> None:
    """From three markers to six: a third off the error without scatter, a tenth at most with it."""

    def rms(markers: int, poses: int, arm: Repeatability | None) -> float:
        cell = replace(some_markers(rigid, markers), repeatability=arm)
        plan = unpolished(cell, poses=poses, **QUICK)
        assert plan.efficiency > 0.85
        return plan.assessment.task_rms

    assert rms(6, 10, None) < 0.8 * rms(3, 10, None)
    few = rms(3, 10, ARM)
    assert 0.9 * few < rms(6, 10, ARM) < few
    assert rms(3, 20, ARM) < 0.75 * few


@pytest.mark.parametrize("criterion", ["task", "A", "D"])
def test_no_plan_is_above_the_bound(criterion: str) -> None:
    """Every plan of four of eleven candidates, by the dense covariance of each visit."""
    rng = np.random.default_rng(4)
    robot = random_robot(rng, 4)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ["base", "joint_compliance"])
    cell = replace(cell, repeatability=ARM, load=Load(60.0, (0.1, 0.0, 0.1), np.pi))
    table = poses_at(rng.uniform(*robot.sample_limits().T, (11, 4)))
    plan = doe.design(cell, poses=4, criterion=criterion, candidates=table)
    model, seen = plan.problem.model, np.ones(3, dtype=bool)
    T = plan.problem.regressor.T
    blocks = []
    for own, rows in zip(table.q, calib.observation(cell, table), strict=True):
        V = covariance_of(cell, model, own, ARM, seen)
        blocks.append(T.T @ rows.T @ np.linalg.solve(V, rows) @ T)
    sums = np.array([sum(blocks[i] for i in chosen) for chosen in combinations(range(11), 4)])
    values = plan.problem.criterion.plain.value(sums)
    best = float(np.max(values))
    assert plan.certificate.bound >= best * (1.0 - 1e-6)
    assert plan.certificate.value == pytest.approx(best, rel=1e-6)
    assert plan.efficiency > 0.9


@pytest.mark.long
def test_compare_predicts_what_design_promises(kr270: Cell) -> None:
    """Free and loaded."""
    cell = with_effects(kr270, "base", "tool", "joint_offset", "joint_compliance:A2,A3,A4")
    cell = replace(cell, repeatability=ARM, design=Planned())
    plan = unpolished(visiting_again(cell, 3), poses=12, **QUICK)
    predicted = predict(experiment_of(cell, plan.poses), POINTS)
    np.testing.assert_allclose(predicted.std, plan.assessment.std, rtol=1e-6)
    (found,) = compared(cell, {"plan": plan.poses})
    assert found.points.task_rms_mm == pytest.approx(1e3 * plan.assessment.task_rms, rel=1e-6)
