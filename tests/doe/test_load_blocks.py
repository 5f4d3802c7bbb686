"""Plans whose load is changed once for a block of poses: what is visited when, and what it tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.api import in_turn, turn_of
from calib.cell import Load
from calib.cell.cell import Repeatability
from calib.errors import CalibError, InputError
from calib.files.write_tables import plan_csv
from calib.poses import poses_at
from calib.poses.load_blocks import even_blocks, turns
from doe.ahead.coming import match, whole_day
from doe.day.day import day_of
from tests.doe.test_run_order import SLOW, cell_of

OPTIONS: dict[str, Any] = {"candidates": 300, "reapproach": 0}


def loaded(*effects: str) -> Cell:
    return replace(
        cell_of("tool", "joint_offset", *effects),
        load=Load(5.0, (0.1, 0.0, 0.0)),
        gravity=np.array([0.0, -9.80665, 0.0]),
        repeatability=Repeatability(1e-4, 0.0),
    )


@pytest.fixture(scope="module")
def plan() -> doe.Design:
    return doe.design(loaded("joint_compliance"), poses=12, load_blocks=3, **OPTIONS)


def test_blocks_are_read_there_and_back() -> None:
    """Two blocks, of two poses and of three: free 0 .. 4, loaded 5 .. 9."""
    block = even_blocks(2, 5)
    assert block.tolist() == [1, 1, 1, 2, 2]
    assert turns(block).tolist() == [0, 1, 2, 7, 6, 5, 8, 9, 4, 3]


def test_the_load_is_changed_so_often(plan: doe.Design) -> None:
    cell, day = plan.problem.cell, plan.day
    mass = in_turn(cell, plan.poses).load_mass
    assert int((np.diff(mass) != 0.0).sum()) == int(day.changes.sum()) == 3
    assert sorted(day.stops.names) == sorted(
        f"{name}_{state}" for name in plan.poses.names for state in ("free", "loaded")
    )
    assert day.standing == 24 * (SLOW.settle + SLOW.reading) + 3 * SLOW.load
    own, *others = sorted(plan.load_schedules, key=lambda entry: not entry.planned)
    assert (own.changes, own.seconds) == (3, day.seconds)
    assert own.after == (plan.poses.names[3], plan.poses.names[7], plan.poses.names[11])
    assert own.task_rms == plan.assessment.task_rms
    assert [entry.changes for entry in others] == [24, 1, 2, 4]
    assert not any(entry.planned for entry in others)


def test_readings_come_when_the_day_says(plan: doe.Design) -> None:
    """The ways of the arm are as long back as there."""
    cell, poses = plan.problem.cell, plan.poses
    readings = calib.api.readings(cell, poses).take(turn_of(cell, poses))
    np.testing.assert_allclose(readings.time, plan.day.times, rtol=1e-9)
    assert readings.names == plan.day.stops.names


def test_a_plan_on_paper_keeps_its_blocks(plan: doe.Design, tmp_path: Path) -> None:
    cell, path = plan.problem.cell, tmp_path / "plan.csv"
    path.write_text(plan_csv(cell, plan.poses))
    again = calib.load_plan(cell, path)
    assert plan.poses.load_block is not None
    np.testing.assert_array_equal(again.load_block, plan.poses.load_block)
    assert day_of(cell, again).seconds == pytest.approx(plan.day.seconds, rel=1e-6)


def test_refits_scatter_as_promised(plan: doe.Design) -> None:
    """Sixty days: chi-square over its degrees of freedom, within three deviations of one."""
    cell, model = plan.problem.cell, plan.problem.model
    own = [p.effect != "base" for p in model.parameters]
    errors = []
    for seed in range(60):
        data = calib.simulate(cell, plan.poses, rng=seed)
        found = calib.identify(cell, data)
        errors.append((found.values - model.initial)[own] / plan.assessment.std[own])
    chi2 = float(np.mean(np.square(errors)))
    assert abs(chi2 - 1.0) < 3.0 * np.sqrt(2.0 / np.size(errors))


def test_blocks_tell_more_where_the_arm_scatters_and_cost_less_time(plan: doe.Design) -> None:
    each = doe.design(plan.problem.cell, poses=12, **OPTIONS)
    assert plan.assessment.task_rms < each.assessment.task_rms
    assert plan.day.standing < each.day.standing
    assert plan.efficiency > 0.9


def test_half_a_day_is_gone_on_with(plan: doe.Design) -> None:
    """What is left of the plan is what was not read, in the order of the blocks."""
    cell = plan.problem.cell
    done = calib.simulate(cell, plan.poses, rng=0).take(slice(10))
    left = match(cell, plan.poses, done.poses)
    assert len(left.left) == 14
    day, pose = whole_day(cell, done, plan.poses, left.left)
    expected = in_turn(cell, plan.poses)
    np.testing.assert_array_equal(day.poses.q, expected.q)
    np.testing.assert_array_equal(pose[10:], turn_of(cell, plan.poses)[10:] % 12)


REFUSED: list[tuple[Cell, dict[str, Any], str]] = [
    (cell_of("tool"), {"load_blocks": 1}, "need a load to change"),
    (loaded(), {"load_blocks": 5}, "8 poses in 5 blocks of load cannot be; ask for 1 to 4"),
    (loaded(), {"load_blocks": 2, "trend_free": True}, "free of trends knows no blocks of load"),
    (loaded("base_drift"), {"load_blocks": 2}, "does not go with blocks of load"),
]


@pytest.mark.parametrize(("cell", "asked", "said"), REFUSED)
def test_blocks_that_cannot_be(cell: Cell, asked: dict[str, Any], said: str) -> None:
    with pytest.raises(CalibError, match=said):
        doe.design(cell, poses=8, **asked)


def test_columns_that_cannot_be(tmp_path: Path) -> None:
    path = tmp_path / "plan.csv"
    path.write_text("pose,j1_deg,j2_deg,load_block\na,0,0,2\nb,10,0,1\n")
    with pytest.raises(InputError, match=r"line 3.*load_block.*comes after a later block"):
        calib.load_plan(loaded(), path)
    with pytest.raises(InputError, match=r"load_block.*needs a \[load\] in the cell"):
        calib.load_plan(cell_of("tool"), path)


def test_a_prescribed_side_is_kept_under_both_loads() -> None:
    cell, q = loaded("backlash"), np.array([[0.0, 0.3], [0.5, -0.2], [1.0, 0.4]])
    plan = replace(
        poses_at(q, approach=np.array([[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])),
        load_block=even_blocks(1, 3),
    )
    stops = day_of(cell, plan).stops
    assert stops.approach is not None
    np.testing.assert_array_equal(stops.approach[3:], stops.approach[:3][::-1])
