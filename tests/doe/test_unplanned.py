"""Errors that depend on the order: a plan chooses poses without them, and says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.errors import CalibError, InputError
from calib.poses import poses_at
from doe.forecast.coming import whole_day
from tests.doe.constraints.arms import planar

QUICK: dict[str, Any] = {"poses": 10, "criterion": "D", "candidates": 300}


def cell_of(*effects: str) -> Cell:
    arm = planar(2)
    return replace(arm, robot=replace(arm.robot, speeds=np.ones(2)), effects=effects)


def test_the_plan_is_that_of_the_model_without_them() -> None:
    lacking = doe.design(cell_of("tool", "joint_offset"), **QUICK)
    more = ("backlash:j1", "base_drift", "thermal_expansion", "settling")
    plan = doe.design(cell_of("tool", *more, "joint_offset"), **QUICK)
    np.testing.assert_array_equal(plan.poses.q, lacking.poses.q)
    assert (plan.value, plan.bound) == (lacking.value, lacking.bound)
    assert plan.problem.unplanned == more
    (note,) = [own for own in plan.notes if own.startswith("not planned for")]
    assert all(effect in note for effect in more)
    assert not any(own.startswith("not planned for") for own in lacking.notes)


def test_no_plan_for_them_alone() -> None:
    with pytest.raises(doe.CannotIdentify, match="base_drift depends on time, which no choice of"):
        doe.design(cell_of("base_drift", "backlash"), **QUICK)
    with pytest.raises(CalibError, match="depends on approach, which no choice of poses settles"):
        doe.design(cell_of("tool"), discriminate=("backlash:j1", "joint_offset:j2"), **QUICK)


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
    cell, rng = cell_of("tool", "joint_offset", "backlash", "base_drift"), np.random.default_rng(0)
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
