"""Errors common to all readings before they are read: a plan expects what days turn out to have.

The days are simulated by plain scaling and shifting of the points that the arm shows; the values follow
by least squares on the derivatives.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import doe
from calib import Cell
from calib.arrays import Array
from calib.cell import Repeatability
from calib.cell.planned import Planned
from calib.cell.targets import targets_of
from calib.instruments.common_errors import CommonError
from calib.poses import poses_at
from calib.simulation import drawn_readings
from doe.assess import assess
from studies.demo.embedded import embedded_cell
from tests.helpers import with_effects

SCALE, ZERO = 2e-5, 3e-6


@pytest.fixture(scope="module")
def plain() -> Cell:
    cell = with_effects(embedded_cell(), "base", "tool", "geometry")
    exact = Repeatability(0.0, 0.0)
    return replace(cell, load=None, design=Planned(), repeatability=exact)


@pytest.fixture(scope="module")
def stated(plain: Cell) -> Cell:
    common = (CommonError("scale_um_m", SCALE), CommonError("r0_um", ZERO))
    (tracker,) = plain.instruments
    return replace(plain, instruments=(replace(tracker, common=common),))


def planned(cell: Cell) -> doe.Design:
    """Of fifteen candidates: nothing is to be searched."""
    q = np.random.default_rng(1).uniform(*cell.robot.sample_limits().T, (15, cell.robot.dof))
    return doe.design(cell, poses=15, candidates=poses_at(q, names=[f"p{i}" for i in range(15)]))


@pytest.fixture(scope="module")
def plan(stated: Cell) -> doe.Design:
    return planned(stated)


def errors_of_days(cell: Cell, plan: doe.Design, days: int) -> tuple[float, Array]:
    """RMS at the targets over days that draw scale and zero, and the scatter of the values."""
    model, rng = plan.problem.model, np.random.default_rng(0)
    truth = np.zeros(len(model.parameters))
    points, J = replace(model).jacobian(truth, plan.poses)
    at_targets, J_targets = replace(model).jacobian(truth, targets_of(cell)[0])
    rows = J.reshape(-1, J.shape[-1])
    inverse = np.linalg.pinv(rows * model.sizes) * 1.0
    length = np.linalg.norm(points, axis=-1, keepdims=True)
    squares, values = [], []
    for _ in range(days):
        scale, zero = SCALE * rng.normal(), ZERO * rng.normal()
        read = points * (1.0 + scale) + zero * points / length
        read = read + rng.normal(size=points.shape) * cell.noise.along
        found = model.sizes * (inverse @ (read - points).ravel())
        values.append(found)
        squares.append(((J_targets @ found) ** 2).sum() / at_targets[..., 0].size)
    return float(np.sqrt(np.mean(squares))), np.std(values, axis=0)


def test_a_plan_expects_the_error_that_days_have(
    plain: Cell, stated: Cell, plan: doe.Design
) -> None:
    rms, std = errors_of_days(stated, plan, 600)
    assert plan.assessment.task_rms == pytest.approx(rms, rel=0.08)
    np.testing.assert_allclose(plan.assessment.std, std, rtol=0.15)
    assert plan.assessment.common > 0.5 * plan.assessment.task_rms
    assert any("[instrument.common]" in own for own in plan.granted)
    # The criterion and its certificate are those without them.
    without = planned(plain)
    np.testing.assert_array_equal(without.poses.q, plan.poses.q)
    assert without.value == plan.value
    assert without.assessment.task_rms == pytest.approx(without.value * 1e-3)
    assert without.assessment.common == 0.0


def test_without_one_pose_they_are_there_still(plan: doe.Design) -> None:
    fewer = assess(plan.problem, plan.poses.q[1:])
    assert plan.assessment.without_pose[0] == pytest.approx(fewer.task_rms, rel=1e-6)
    assert fewer.common > 0.0


def test_what_is_enough_knows_them(plain: Cell, stated: Cell, plan: doe.Design) -> None:
    q = plan.poses.q
    model = plan.problem.model
    truth = np.zeros(len(model.parameters))
    poses = poses_at(q, names=[f"p{i}" for i in range(len(q))])
    data = drawn_readings(model, truth, poses, plain.noise, np.random.default_rng(0))
    now = doe.enough(stated, data, goal=1e-9)
    step, further = now.steps[0], now.fresh[0]
    assert step.common == pytest.approx(plan.assessment.common, rel=0.01)
    assert step.task_rms == pytest.approx(
        float(np.hypot(step.from_parameters, step.common)), rel=0.02
    )
    assert further.from_parameters < step.from_parameters
    assert further.common > 0.8 * step.common
    alone = doe.enough(plain, data)
    assert alone.steps[0].common == 0.0
    assert step.task_most > alone.steps[0].task_most
    assert now.found is not None
    np.testing.assert_allclose(step.std, now.found.std, rtol=0.02)
