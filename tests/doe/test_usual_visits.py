"""Second visits by default: when a plan has them, what its proof then says, and what they cost."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.cell import Repeatability
from calib.cell.planned import AskedLevels, Planned
from calib.errors import CalibError
from calib.poses import poses_at
from calib.poses.moves import visits
from doe.assess import assess
from doe.plan import named
from doe.problem.request import Request, levels_of
from doe.visiting import usual_reapproaches
from tests.helpers import cell_of, first_markers, random_robot, with_effects

QUICK: dict[str, Any] = {"candidates": 500, "refine": False, "fresh": False, "criterion": "D"}


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, "base", "joint_offset"), load=None, design=Planned())


@pytest.mark.parametrize(("poses", "again"), [(19, 0), (20, 4), (40, 4), (55, 6), (100, 10)])
def test_a_tenth_at_least_four_of_twenty_poses_or_more(cell: Cell, poses: int, again: int) -> None:
    assert usual_reapproaches(cell, Request(poses, "D")) == again


def test_none_where_something_speaks_against_it(cell: Cell) -> None:
    asked = Request(30, "D")
    q = np.random.default_rng(0).uniform(*cell.robot.sample_limits().T, (6, 6))
    back = named(np.concatenate([q, q[:2]]))
    assert usual_reapproaches(cell, replace(asked, fixed=named(q))) == 4
    assert usual_reapproaches(cell, replace(asked, fixed=back)) == 0
    assert usual_reapproaches(cell, replace(asked, rivals=("backlash:A2", "backlash:A3"))) == 0
    assert usual_reapproaches(cell, replace(asked, repeats=True)) == 0
    levels = levels_of(cell, {"A2": AskedLevels(10, 3)}, None)
    assert usual_reapproaches(cell, replace(asked, levels=levels)) == 0
    for known in (Repeatability(2e-5, 0.0), Repeatability(0.0, 0.0)):
        assert usual_reapproaches(replace(cell, repeatability=known), asked) == 0


@pytest.fixture(scope="module")
def usual(cell: Cell) -> doe.Design:
    return doe.design(cell, poses=20, **QUICK)


def test_they_are_among_the_poses_that_were_asked_for(cell: Cell, usual: doe.Design) -> None:
    """The plan is that of fewer poses, some of them visited again with others in between."""
    assert usual.reapproaches is not None
    assert not usual.reapproaches.asked
    assert len(usual.poses) == 20
    counts = np.bincount(visits(usual.poses))
    assert counts.max() == 1
    assert sorted(np.bincount(usual.poses.configuration)) == [1] * 12 + [2] * 4
    asked = doe.design(cell, poses=16, reapproach=4, **QUICK)
    np.testing.assert_array_equal(usual.poses.q, asked.poses.q)
    assert (usual.value, usual.bound) == (asked.value, asked.bound)
    assert asked.reapproaches is not None
    assert asked.reapproaches.asked


def test_what_they_cost_is_said(cell: Cell, usual: doe.Design) -> None:
    """Against a plan without them, and the way to that plan."""
    assert usual.reapproaches is not None
    without = doe.design(cell, poses=20, reapproach=0, **QUICK)
    assert without.reapproaches is None
    assert len(np.unique(without.poses.configuration)) == 20
    assert not any("second" in note for note in without.notes)
    assert usual.reapproaches.instead == pytest.approx(without.assessment.task_rms, rel=0.03)
    (cost,) = [note for note in usual.notes if "--reapproach 0" in note]
    assert f"{usual.reapproaches.instead * 1e3:.3g} mm" in cost
    assert f"{usual.assessment.task_rms * 1e3:.3g} mm" in cost


def test_none_beside_a_reference(cell: Cell) -> None:
    assert doe.design(cell, poses=20, reference_every=8, **QUICK).reapproaches is None


def test_none_where_the_candidates_are_the_plan(cell: Cell) -> None:
    q = np.random.default_rng(1).uniform(*cell.robot.sample_limits().T, (20, 6))
    plan = doe.design(cell, poses=20, **{**QUICK, "candidates": poses_at(q)})
    np.testing.assert_allclose(np.sort(plan.poses.q, axis=0), np.sort(q, axis=0))


def test_a_proof_and_second_visits_are_refused_together(cell: Cell) -> None:
    with pytest.raises(CalibError, match="knows no second visits"):
        doe.design(cell, poses=9, reapproach=2, prove=True, **QUICK)


@pytest.mark.parametrize("criterion", ["task", "A", "D"])
@pytest.mark.parametrize("repeats", [False, True], ids=["once", "repeated"])
def test_no_plan_of_as_many_stops_is_above_the_bound(criterion: str, repeats: bool) -> None:
    """Every plan of four of nine candidates with one of them again, and every plan of five."""
    rng = np.random.default_rng(4)
    robot = random_robot(rng, 4)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ["base", "joint_offset"])
    table = poses_at(rng.uniform(*robot.sample_limits().T, (9, 4)))
    options: dict[str, Any] = {"candidates": table, "fresh": False, "repeats": repeats}
    plan = doe.design(cell, poses=4, criterion=criterion, reapproach=1, **options)
    T = plan.problem.regressor.T
    B = calib.observation(cell, table) @ T / cell.noise.along
    blocks = np.swapaxes(B, -1, -2) @ B
    stops = [(*own, again) for own in combinations(range(9), 4) for again in own]
    stops += list(combinations(range(9), 5))
    sums = np.array([blocks[list(own)].sum(axis=0) for own in stops])
    values = np.asarray(plan.problem.criterion.plain.value(sums))
    assert plan.certificate.bound >= values.max() * (1.0 - 1e-6)
    chosen = [int(np.abs(table.q - q).max(axis=1).argmin()) for q in plan.poses.q]
    own = float(plan.problem.criterion.plain.value(blocks[chosen].sum(axis=0)))
    assert plan.certificate.value == pytest.approx(own, rel=1e-6)


@pytest.mark.long
def test_all_poses_are_kept_where_fewer_leave_the_model_open(kr270: Cell) -> None:
    """51 parameters by one marker: of sixteen poses it has 48 readings, of twenty sixty."""
    effects = ("base", "tool", "geometry", "transmission_harmonic:A1,A2,A3,A4,A5,A6")
    one = first_markers(with_effects(kr270, *effects), 1)
    one = replace(one, load=None, design=Planned())
    plan = doe.design(one, poses=20, **QUICK)
    assert 48 < len(plan.problem.model.parameters) <= 60
    assert plan.reapproaches is None
    assert len(np.unique(plan.poses.configuration)) == 20
    assert np.isfinite(assess(plan.problem, plan.poses.q).std).all()
