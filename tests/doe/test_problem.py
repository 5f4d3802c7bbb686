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
from calib.arrays import Array
from calib.cell.planned import Planned
from calib.errors import CalibError, InputError
from calib.inference.widths import SizePrior
from calib.model.build import build
from calib.poses import poses_at
from calib.simulation import drawn_readings
from doe.constraints import scene_of, visible
from doe.forecast.coming import whole_day
from doe.information import target_rows
from doe.plan import assess
from doe.planning import choose
from doe.problem import RIDGE, Problem, problem_of
from doe.request import CannotIdentify, Request
from studies.demo.embedded import embedded_cell
from tests import two_arms
from tests.doe.constraints.arms import planar
from tests.doe.problems import unpolished, visiting_again
from tests.helpers import read_by


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


def some(cell: Cell, count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(*cell.robot.sample_limits().T, (count, cell.robot.dof))


def told(problem: Problem) -> Array:
    """What every plan has, of the values in plausible sizes."""
    back = np.linalg.inv(problem.regressor.T)
    own = back.T @ (problem.fixed - RIDGE * np.eye(len(back))) @ back
    return np.asarray(own * np.outer(problem.model.sizes, problem.model.sizes))


def test_what_sizes_tell_is_in_every_plan(cell: Cell) -> None:
    known, prior = of_known_sizes(cell, 1.0)
    problem = problem_of(known, Request(6, "task"))
    own, sizes = told(problem), problem.model.sizes
    at = np.array([p.effect == "geometry" for p in problem.model.parameters])
    cov = prior.covariance / np.outer(sizes[at], sizes[at])
    np.testing.assert_allclose(own[np.ix_(at, at)] @ cov, np.eye(len(cov)), atol=1e-6)
    assert np.abs(own[~at]).max() < 1e-6 * np.abs(own).max()


def test_what_is_measured_adds_up_and_what_is_hidden_counts_nothing(cell: Cell) -> None:
    q, normals = some(cell, 20, 1), np.full((3, 3), np.nan)
    normals[2] = [1.0, 0.0, 0.0]
    cell = replace(
        cell,
        instruments=read_by(cell.noise, np.array([4.0, 0.0, 1.5])),
        marker_normals=normals,
        marker_acceptance=np.array([np.nan, np.nan, np.radians(60.0)]),
    )
    problem = problem_of(cell, Request(6, "task", fixed=poses_at(q[:3])))
    _, J = problem.model.jacobian(problem.regressor.values, poses_at(q))
    seen = visible(scene_of(cell, q))
    rows = J.reshape(20, 3, 3, -1) * problem.model.sizes / cell.noise.along * seen[..., None, None]
    three, all_ = (np.einsum("mkri,mkrj->ij", own, own) for own in (rows[:3], rows))
    own, judged = told(problem), assess(problem, q[3:])
    np.testing.assert_allclose(own, three, rtol=1e-6, atol=1e-6 * np.abs(own).max())
    std = np.sqrt(np.diag(np.linalg.inv(all_))) * problem.model.sizes
    np.testing.assert_allclose(judged.std, std, rtol=1e-4)
    assert 5 < judged.hidden == (~seen[3:]).sum() < 17


def test_errors_at_targets_count_at_the_markers_or_at_the_tip() -> None:
    cell = planar(2, markers=np.array([[0.0, 0.3, 0.0], [0.0, 0.5, 0.0]]))
    model, at = build(replace(cell, effects=("joint_offset:j2",))).model, poses_at(np.zeros((1, 2)))
    tip, markers = (target_rows(model, np.zeros(1), at, own)[0] for own in (False, True))
    np.testing.assert_allclose(np.linalg.norm(tip), 1.0)
    # The mean square of both: 1 m ahead of the joint, 0.3 and 0.5 m beside it.
    np.testing.assert_allclose((markers**2).sum(), 1.0 + (0.09 + 0.25) / 2.0)


def test_a_number_of_poses_is_refused_just_where_no_plan_of_it_tells_all(cell: Cell) -> None:
    """By the rank of random plans, which is that of the best where poses lie in general."""
    problem = problem_of(cell, Request(8, "D", candidates=poses_at(some(cell, 100, 2))))
    blocks, rng = problem.information(problem.pool.q), np.random.default_rng(3)

    def rank(count: int) -> int:
        plan = rng.choice(len(blocks), count, replace=False)
        return int(np.linalg.matrix_rank(blocks[plan].sum(axis=0), tol=1e-6))

    enough = next(n for n in range(1, 12) if rank(n) == len(problem.model.parameters))
    few, many = (
        replace(problem, request=replace(problem.request, poses=count))
        for count in (enough - 1, enough)
    )
    with pytest.raises(CannotIdentify, match=f"{enough - 1} poses leave .* parameters open"):
        choose(few, few.posed())
    choose(many, many.posed())


def test_a_plan_beside_known_sizes_needs_fewer_poses_and_keeps_its_proof(cell: Cell) -> None:
    known, prior = of_known_sizes(cell, 0.02)
    q, rng = some(cell, 120, 0), np.random.default_rng(1)
    found = doe.design(known, poses=4, candidates=poses_at(q))
    assert found.value >= found.bound * (1.0 - 1e-9)
    at = [p.effect == "geometry" for p in found.problem.model.parameters]
    assert (found.assessment.std[at] < 1.001 * prior.std).all()
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
    cell = planar_cell("tool", "joint_offset", "backlash", "base_drift")
    rng = np.random.default_rng(0)
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
