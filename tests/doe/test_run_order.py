"""Plans of models that depend on the order: sides, moments, and the way that they are written."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.cell.planned import Pace
from calib.errors import CalibError, InputError
from calib.files.write_tables import plan_csv
from calib.poses import poses_at
from doe.ahead.coming import whole_day
from doe.optimal.blocks import unpack
from doe.problem import Problem, problem_of
from doe.problem.pool import Pool, chunked, pool_of
from doe.problem.request import Request
from doe.problem.visits import Visits
from doe.run_order import in_run_order
from doe.solve import Progress, choose
from tests.doe.constraints.arms import planar

SLOW = Pace(speed=0.02, settle=30.0, reading=60.0)
"""A day of which an hour passes soon."""


def cell_of(*effects: str) -> Cell:
    arm = planar(2)
    robot = replace(arm.robot, speeds=np.ones(2))
    return replace(arm, robot=robot, pace=SLOW, effects=effects)


ALL = cell_of("tool", "joint_offset", "backlash:j1", "base_drift")
QUICK: dict[str, Any] = {"poses": 14, "criterion": "D", "candidates": 400}


@cache
def planned(*effects: str) -> doe.Design:
    """A plan for a tool, joint offsets and these, made once for all that ask for it."""
    return doe.design(cell_of("tool", "joint_offset", *effects), reapproach=0, **QUICK)


def candidates(problem: Problem, q: np.ndarray) -> Pool:
    """Every configuration (k, 2) from both sides of the first joint at each moment."""
    moments = len(problem.choice.times)
    rows = list(itertools.product(range(len(q)), (-0.1, 0.1), range(moments)))
    move = np.array([[side, 0.0] for _, side, _ in rows])
    moment = np.array([k for _, _, k in rows])
    visits = Visits(q[[i for i, _, _ in rows]], move, moment, problem.choice.times[moment])
    return pool_of(problem.regressor, problem.constraints, None, chunked(visits), len(rows))


@pytest.mark.parametrize("criterion", ["D", "A", "task"])
@pytest.mark.parametrize("seed", range(3))
def test_the_certificate_against_all_plans(criterion: str, seed: int) -> None:
    """Six moments, at each one of three configurations from one of two sides: 46 656 plans."""
    problem = problem_of(ALL, Request(6, criterion))
    q = np.random.default_rng(seed).uniform(-2.0, 2.0, (3, 2))
    pool = candidates(problem, q)
    by_moment = [np.flatnonzero(pool.level == k) for k in range(6)]
    assert [len(own) for own in by_moment] == [6] * 6
    plans = np.array(list(itertools.product(*by_moment)))
    parts = np.array_split(plans, 50)
    M = (problem.fixed + unpack(pool.packed[part].sum(axis=1)) for part in parts)
    best = max(float(problem.criterion.plain.value(own).max()) for own in M)
    found = choose(problem, pool, Progress())
    assert found.relaxed.bound >= best * (1.0 - 1e-9)
    assert best * (1.0 - 1e-3) <= found.value <= best * (1.0 + 1e-9)


def test_orders_against_all_of_them() -> None:
    """Of the 720 orders of six poses that tell enough, none has much shorter ways."""
    problem = problem_of(cell_of("tool", "joint_offset", "base_drift"), Request(6, "D"))
    rng = np.random.default_rng(0)
    visits = Visits(rng.uniform(-2.5, 2.5, (6, 2)), None, np.arange(6), problem.choice.times)
    found = in_run_order(problem, visits)

    def told(order: tuple[int, ...]) -> float:
        own = replace(visits.take(list(order)), moment=np.arange(6), time=problem.choice.times)
        M = problem.fixed + problem.information(own).sum(axis=0)
        return float(problem.criterion.plain.value(M))

    def way(q: np.ndarray) -> float:
        return float(np.abs(np.diff(q, axis=0)).max(axis=1).sum())

    values = {order: told(order) for order in itertools.permutations(range(6))}
    best = max(values.values())
    chosen = tuple(int(np.abs(visits.q - q).sum(axis=1).argmin()) for q in found.q)
    assert values[chosen] >= 0.98 * best
    enough = [way(visits.q[list(o)]) for o, value in values.items() if value >= 0.98 * best]
    assert way(found.q) <= 1.05 * min(enough)


@pytest.mark.parametrize(
    "effects",
    [("backlash",), ("backlash", "settling"), ("base_drift",), ("backlash:j1", "tracker_drift")],
)
def test_a_plan_on_paper_tells_what_was_promised(tmp_path: Path, effects: tuple[str, ...]) -> None:
    """Standard deviations from the file alone, by calib, are those of the design."""
    plan = planned(*effects)
    cell = plan.problem.cell
    (tmp_path / "plan.csv").write_text(plan_csv(cell, plan.poses))
    poses = calib.load_plan(cell, tmp_path / "plan.csv")
    J = calib.observation(cell, poses)
    rows = J.reshape(-1, J.shape[-1]) / plan.problem.model.readout.even
    std = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(std, plan.assessment.std, rtol=1e-4)


def test_sides_are_balanced() -> None:
    plan = planned("backlash")
    assert plan.poses.approach is not None
    assert (np.abs(plan.poses.approach.sum(axis=0)) <= 4).all()


def test_a_planned_order_tells_more_than_one_by_chance() -> None:
    plan = planned("base_drift")
    q = plan.poses.q[np.random.default_rng(0).permutation(len(plan.poses))]
    by_chance = poses_at(q, time=plan.poses.time)
    judged = doe.design(plan.problem.cell, reapproach=0, against={"by chance": by_chance}, **QUICK)
    assert judged.rivals["by chance"].efficiency < plan.efficiency


def test_the_time_is_needed() -> None:
    cell = cell_of("tool", "base_drift")
    slow = replace(cell, robot=replace(cell.robot, speeds=None))
    with pytest.raises(CalibError, match="joint speeds are known"):
        doe.design(slow, poses=6)
    with pytest.raises(CalibError, match="does not go with levels"):
        doe.design(cell, levels="j1=3x2")
    with pytest.raises(
        CalibError, match="does not say when its poses are read; give its column time_s"
    ):
        doe.design(cell, poses=6, extend=poses_at(np.zeros((1, 2))))


def test_a_plan_that_is_extended_goes_on_in_time() -> None:
    """The deviations are those of all poses together, the new ones after the others."""
    cell = cell_of("tool", "joint_offset", "base_drift")
    options: dict[str, Any] = {"criterion": "D", "candidates": 400}
    first = doe.design(cell, poses=8, **options).poses
    assert first.time is not None
    plan = doe.design(cell, poses=6, extend=first, against={"same": first}, **options)
    assert plan.poses.time is not None
    assert plan.poses.time.min() > first.time.max()
    assert 0.5 < plan.efficiency <= 1.0
    time = np.concatenate([first.time, plan.poses.time])
    J = calib.observation(cell, poses_at(np.concatenate([first.q, plan.poses.q]), time=time))
    rows = J.reshape(-1, J.shape[-1]) / plan.problem.model.readout.even
    std = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(std, plan.assessment.std, rtol=1e-4)


def test_a_plan_is_read_in_its_order(tmp_path: Path) -> None:
    cell, path = cell_of("tool"), tmp_path / "plan.csv"
    path.write_text(
        "pose,j1_deg,j2_deg,order,time_s,approach_j1,approach_j2,move_j1_deg,move_j2_deg\n"
        "b,10,0,2,30,-1,0,5,0\na,20,0,1,0,1,0,40,0\n"
    )
    poses = calib.load_plan(cell, path)
    assert poses.names == ("a", "b")
    assert poses.approach is not None
    assert poses.motion is not None
    np.testing.assert_array_equal(poses.approach, [[1.0, 0.0], [-1.0, 0.0]])
    np.testing.assert_allclose(poses.motion, np.radians([[40.0, 0.0], [5.0, 0.0]]))
    path.write_text("pose,j1_deg,j2_deg,order\na,0,0,1\nb,10,0,1\n")
    with pytest.raises(InputError, match="column order: '1' stands twice; number the poses"):
        calib.load_plan(cell, path)


def test_what_is_left_of_a_plan_keeps_its_sides_and_times() -> None:
    cell = cell_of("tool", "joint_offset", "backlash", "base_drift")
    plan = doe.design(cell, poses=12, criterion="D", candidates=300).poses
    data = calib.simulate(cell, plan.take(slice(6)), rng=0)
    day, pose = whole_day(cell, data, plan, np.arange(6, 12))
    assert pose.tolist() == [-1] * 6 + list(range(6, 12))
    assert day.poses.approach is not None
    assert day.poses.time is not None
    assert plan.time is not None
    np.testing.assert_array_equal(day.poses.approach, plan.approach)
    np.testing.assert_allclose(np.diff(day.poses.time[6:]), np.diff(plan.time[6:]))


def test_what_was_assumed_of_heat_is_said() -> None:
    """A course that nobody stated, one that ends before the day, and a day too short for heat."""
    options: dict[str, Any] = {"poses": 10, "criterion": "D", "candidates": 300}
    cell = cell_of("tool", "joint_offset", "thermal_expansion")

    def notes(pace: Pace) -> str:
        return " ".join(doe.design(replace(cell, pace=pace), **options).notes)

    assumed = "course of the temperature is assumed: from 20 degC up by 4 K"
    assert assumed in notes(SLOW)
    stated = replace(SLOW, course=((0.0, 20.0), (6000.0, 23.0)))
    assert "temperature" not in notes(stated)
    short = replace(SLOW, course=((0.0, 20.0), (600.0, 23.0)))
    assert "temperature_degC ends after 10 min" in notes(short)
    slow = cell_of("tool", "joint_offset", "warm_up:base")
    said = " ".join(doe.design(slow, **options).notes)
    assert "warm_up:base is planned for a time constant of 60 min" in said
    brief = replace(cell_of("tool", "joint_offset", "warm_up:j1"), pace=Pace())
    with pytest.raises(CalibError, match="short beside a warm-up of an hour: plan a longer day"):
        doe.design(brief, **options)
    level = replace(cell, pace=replace(SLOW, course=((0.0, 20.0),)))
    with pytest.raises(CalibError, match="changes by no more than 0 K: plan a longer day"):
        doe.design(level, **options)
