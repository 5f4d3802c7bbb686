"""What every plan has beside its poses; what it determines, leaves out and refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell, load_cell
from calib.cell.planned import Planned
from calib.errors import CalibError, InputError
from calib.inference.widths import SizePrior
from calib.model.build import build
from calib.poses import poses_at
from calib.simulation import drawn_readings
from doe.candidates import Pool
from doe.forecast.coming import whole_day
from doe.planning import choose
from doe.problem import RIDGE, Problem, problem_of
from doe.request import CannotIdentify, Request
from studies.demo.embedded import embedded_cell
from tests import two_arms
from tests.doe.constraints.arms import planar
from tests.doe.problems import unpolished, visiting_again


@pytest.fixture(scope="module")
def cell() -> Cell:
    effects = ("base", "tool", "geometry")
    return replace(embedded_cell(), effects=effects, load=None, knots={}, design=Planned())


def of_known_sizes(cell: Cell, width: float) -> tuple[Cell, SizePrior]:
    """The cell that states how large errors of its constants are, mm and mrad, and what that says."""
    known = replace(cell, size_prior={"geometry_mrad": width, "geometry_mm": width})
    prior = build(known).model.own_prior
    assert prior is not None
    return known, prior


def in_si(problem: Problem, M: np.ndarray) -> np.ndarray:
    """Information in the coordinates of the criteria, of the values in SI."""
    back = np.linalg.inv(problem.regressor.T)
    return np.asarray(back.T @ M @ back)


def test_what_sizes_tell_is_in_every_plan(cell: Cell) -> None:
    known, prior = of_known_sizes(cell, 1.0)
    cov = prior.covariance
    problem = problem_of(known, Request(6, "task"))
    ridge = RIDGE * np.eye(len(problem.fixed))
    told = in_si(problem, problem.fixed - ridge)
    at = np.array([p.effect == "geometry" for p in problem.model.parameters])
    np.testing.assert_allclose(told[np.ix_(at, at)] @ cov, np.eye(len(cov)), atol=1e-6)
    assert np.abs(told[~at]).max() < 1e-6 * np.abs(told).max()


def test_what_is_measured_in_any_case_adds_up(cell: Cell) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(*cell.robot.sample_limits().T, (3, cell.robot.dof))
    problem = problem_of(cell, Request(6, "task", fixed=poses_at(q)))
    _, J = problem.model.jacobian(problem.regressor.values, poses_at(q))
    rows = J.reshape(-1, J.shape[-1]) / cell.noise.along
    ridge = RIDGE * np.eye(len(problem.fixed))
    told = in_si(problem, problem.fixed - ridge) * np.outer(
        problem.model.sizes, problem.model.sizes
    )
    own = rows * problem.model.sizes
    np.testing.assert_allclose(told, own.T @ own, rtol=1e-6, atol=1e-6 * np.abs(told).max())


def pool(cell: Cell) -> tuple[Problem, Pool]:
    rng = np.random.default_rng(2)
    q = rng.uniform(*cell.robot.sample_limits().T, (200, cell.robot.dof))
    problem = problem_of(cell, Request(8, "D", candidates=poses_at(q)))
    return problem, problem.pool


def test_a_number_of_poses_is_refused_just_where_no_plan_of_it_tells_all(cell: Cell) -> None:
    """By the rank of random plans, which is that of the best where poses lie in general."""
    problem, found = pool(cell)
    p, rng = len(problem.model.parameters), np.random.default_rng(3)
    enough = next(
        n
        for n in range(1, 12)
        if max(
            np.linalg.matrix_rank(
                problem.information(found.q[rng.choice(len(found), n, replace=False)]).sum(axis=0),
                tol=1e-6,
            )
            for _ in range(5)
        )
        == p
    )
    few = replace(problem, request=replace(problem.request, poses=enough - 1))
    with pytest.raises(CannotIdentify, match=f"{enough - 1} poses leave .* parameters open"):
        choose(few, few.posed())
    many = replace(problem, request=replace(problem.request, poses=enough))
    choose(many, many.posed())


def test_a_plan_beside_known_sizes_needs_fewer_poses_and_keeps_its_proof(cell: Cell) -> None:
    known, prior = of_known_sizes(cell, 0.02)
    std = prior.std
    rng = np.random.default_rng(0)
    q = rng.uniform(*cell.robot.sample_limits().T, (120, cell.robot.dof))
    found = doe.design(known, poses=4, candidates=poses_at(q))
    assert found.value >= found.bound * (1.0 - 1e-9)
    assert np.isfinite(found.assessment.std).all()
    told = [s for p, s in zip(found.problem.model.parameters, found.assessment.std, strict=True)
            if p.effect == "geometry"]  # fmt: skip
    assert (np.array(told) < 1.001 * std).all()
    # No plan of these candidates is better than the bound says, the best by their own look included.
    problem = found.problem
    blocks = problem.information(q)
    alone = problem.criterion.plain.value(problem.fixed + blocks)
    plans = [rng.choice(len(q), 4, replace=False) for _ in range(2000)]
    plans += [rng.choice(np.argsort(-alone)[:12], 4, replace=False) for _ in range(200)]
    M = problem.fixed + np.array([blocks[plan].sum(axis=0) for plan in plans])
    best = float(problem.criterion.plain.value(M).max())
    assert problem.criterion.shown(best) >= found.bound * (1.0 - 1e-6)
    assert problem.criterion.shown(best) >= found.value * (1.0 - 1e-6)


HIP = "joint_compliance:hip.compliance"
MARKERS = (
    '[markers_mm]\nright = [30, 40, -50]\nleft = { position = [40, -30, -60], on = "left_hand" }\n'
    "[instrument]\nsigma_mm = 0.02\n"
)


@pytest.fixture(scope="module")
def elastic(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """Two arms on a torso whose first axis is vertical, both hands read by one tracker."""
    folder = tmp_path_factory.mktemp("pair")
    effects = '"base", "tool", "joint_offset", "joint_compliance"'
    return load_cell(two_arms.written(folder, MARKERS, effects=effects))


def plan_of(cell: Cell) -> doe.Design:
    return unpolished(visiting_again(cell, 0), poses=16, candidates=300)


def test_what_no_weight_turns_is_left_out_of_the_plan_and_of_the_fit(elastic: Cell) -> None:
    found = plan_of(elastic)
    left = [name for entry in found.problem.left_out for name in entry.names]
    assert HIP in left
    assert "joint_compliance:bend.compliance" not in left
    assert not set(left) & {p.id for p in found.problem.model.parameters}
    assert any(HIP in note and "no reading changes with it" in note for note in found.notes)
    model = build(elastic, found.poses).model
    truth = np.array([p.size for p in model.parameters]) * 0.1
    data = drawn_readings(model, truth, found.poses, None, np.random.default_rng(0))
    lost = calib.identify(elastic, data).choice.unidentifiable
    assert {name for entry in lost for name in entry.names} == set(left)


def test_what_is_named_with_its_place_is_refused(elastic: Cell) -> None:
    wanted = ("base", "tool", "joint_offset", "joint_compliance:hip,bend,right2,left2")
    with pytest.raises(CannotIdentify, match=HIP):
        plan_of(replace(elastic, effects=wanted))


def test_bearings_of_both_arms_are_planned_for(elastic: Cell) -> None:
    """Their plausible size is a bearing's: two kilograms a link show tilts of the torso."""
    found = plan_of(replace(elastic, effects=(*elastic.effects, "bearing_compliance")))
    planned = {p.id for p in found.problem.model.parameters}
    assert {"bearing_compliance:hip.tilt", "bearing_compliance:right2.tilt"} <= planned


QUICK: dict[str, Any] = {"poses": 10, "criterion": "D", "candidates": 300}


def planar_cell(*effects: str) -> Cell:
    arm = planar(2)
    return replace(arm, robot=replace(arm.robot, speeds=np.ones(2)), effects=effects)


def test_the_plan_is_that_of_the_model_without_them() -> None:
    lacking = doe.design(planar_cell("tool", "joint_offset"), **QUICK)
    more = ("backlash:j1", "base_drift", "thermal_expansion", "settling")
    plan = doe.design(planar_cell("tool", *more, "joint_offset"), **QUICK)
    np.testing.assert_array_equal(plan.poses.q, lacking.poses.q)
    assert (plan.value, plan.bound) == (lacking.value, lacking.bound)
    assert plan.problem.unplanned == more
    (note,) = [own for own in plan.notes if own.startswith("not planned for")]
    assert all(effect in note for effect in more)
    assert not any(own.startswith("not planned for") for own in lacking.notes)


def test_no_plan_for_them_alone() -> None:
    with pytest.raises(CannotIdentify, match="base_drift depends on time, which no choice of"):
        doe.design(planar_cell("base_drift", "backlash"), **QUICK)
    with pytest.raises(CalibError, match="depends on approach, which no choice of poses settles"):
        doe.design(planar_cell("tool"), discriminate=("backlash:j1", "joint_offset:j2"), **QUICK)


def test_a_plan_is_read_in_its_order(tmp_path: Path) -> None:
    cell, path = planar_cell("tool"), tmp_path / "plan.csv"
    path.write_text(
        "pose,j1_deg,j2_deg,order,time_s,approach_j1,approach_j2\nb,10,0,2,30,-1,0\na,20,0,1,0,1,0\n"
    )
    poses = calib.load_plan(cell, path)
    assert poses.names == ("a", "b")
    assert poses.approach is not None
    assert poses.motion is not None
    np.testing.assert_array_equal(poses.approach, [[1.0, 0.0], [-1.0, 0.0]])
    np.testing.assert_allclose(poses.motion[1], np.radians([10.0, 0.0]))
    path.write_text("pose,j1_deg,j2_deg,order\na,0,0,1\nb,10,0,1\n")
    with pytest.raises(InputError, match="column order: '1' stands twice; number the poses"):
        calib.load_plan(cell, path)


def test_what_is_left_of_a_plan_keeps_its_sides_and_times() -> None:
    cell, rng = (
        planar_cell("tool", "joint_offset", "backlash", "base_drift"),
        np.random.default_rng(0),
    )
    q, time = rng.uniform(-2.0, 2.0, (12, 2)), np.cumsum(rng.uniform(10.0, 40.0, 12))
    plan = poses_at(q, approach=rng.choice([-1.0, 1.0], (12, 2)), time=time)
    data = calib.simulate(cell, plan.take(slice(6)), rng=0)
    day, pose = whole_day(cell, data, plan, np.arange(6, 12))
    assert pose.tolist() == [-1] * 6 + list(range(6, 12))
    assert day.poses.approach is not None
    assert day.poses.time is not None
    assert plan.approach is not None
    np.testing.assert_array_equal(day.poses.approach, plan.approach)
    np.testing.assert_allclose(np.diff(day.poses.time[6:]), np.diff(time[6:]))
