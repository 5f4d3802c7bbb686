"""Arms that come to a pose otherwise each time: plans for them, visits again, and orders."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell, readings
from calib.arm.robot import Shapes
from calib.arm.se3 import skew
from calib.arrays import Array
from calib.cell import Load, Repeatability
from calib.cell.planned import Pace, Planned
from calib.errors import CalibError
from calib.files.cell import load_cell
from calib.model import Model
from calib.model.build import build
from calib.poses import Poses, poses_at
from calib.poses.moves import visits
from calib.simulation import drawn_readings
from doe.constraints import broken_at
from doe.information import Regressor
from doe.order import (
    day_of,
    durations,
    over_the_day,
    quickest_order,
    shortest_order,
    with_reapproaches,
)
from doe.plan import named
from doe.problem import Problem, problem_of
from doe.request import Request
from studies.compare.experiment import POINTS, experiment_of, predict
from studies.results.compare import compared
from tests.doe.constraints.arms import LINK, planar
from tests.doe.problems import unpolished, visiting_again
from tests.helpers import cell_of, designed, first_markers, random_robot, with_effects
from tests.studies.command_line import paper_cell, run

EXACT, ARM = Repeatability(0.0, 0.0), Repeatability(3e-5, 5e-5)
QUICK: dict[str, Any] = {"candidates": 300, "criterion": "D"}


def covariance_of(cell: Cell, model: Model, q: Array, arm: Repeatability, seen: Array) -> Array:
    """Of the readings of one visit, marker by marker, by the geometry of a rigid tip alone."""
    poses = readings(cell, poses_at(q[None]))
    frames = model.state(np.zeros(len(model.parameters)), poses.take([0])).frames
    arms = cell.markers[seen] @ frames.R[0, -1].T
    one = np.concatenate([np.hstack([np.eye(3), -skew(a)]) for a in arms])
    H = np.tile(one, (len(poses), 1))
    U = np.repeat([arm.translation, arm.rotation], 3) ** 2
    return np.asarray(np.eye(len(H)) * cell.noise.along**2 + (H * U) @ H.T)


@pytest.mark.long
def test_compare_predicts_what_design_promises(kr270: Cell) -> None:
    """Free and loaded."""
    cell = with_effects(kr270, "base", "tool", "joint_offset", "joint_compliance:A2,A3,A4")
    cell = replace(cell, repeatability=ARM, design=Planned())
    plan = unpolished(visiting_again(cell, 3), poses=12, candidates=300)
    predicted = predict(experiment_of(cell, plan.poses), POINTS)
    np.testing.assert_allclose(predicted.std, plan.assessment.std, rtol=1e-6)
    (found,) = compared(cell, {"plan": plan.poses})
    assert found.points.task_rms_mm == pytest.approx(1e3 * plan.assessment.task_rms, rel=1e-6)


@pytest.mark.parametrize("case", ["free", "free and loaded", "what compliances do not show"])
def test_information_is_that_of_readings_which_err_together(kr270: Cell, case: str) -> None:
    """Against the observation matrix and the dense covariance of a visit, a marker hidden.

    Of known geometry without weights free readings hold nothing but what the approach was off by.
    """
    cell = with_effects(kr270, "base", "joint_offset", "joint_compliance:A2,A3")
    cell = replace(cell, repeatability=ARM, design=Planned())
    if case == "free":
        cell = replace(cell, load=None)
    if case == "what compliances do not show":
        robot = replace(cell.robot, masses=np.zeros(6))
        cell = replace(with_effects(cell, "joint_compliance:A2,A3,A4,A5,A6"), robot=robot)
    problem = problem_of(cell, Request(poses=8, criterion="D"))
    q = np.random.default_rng(2).uniform(*cell.robot.sample_limits().T, (4, 6))
    visible = np.array([[True] * 3, [True, False, True], [False, True, True], [True] * 3])
    back = np.linalg.inv(problem.regressor.T)
    found = problem.regressor.information(q, visible)
    B = calib.observation(cell, q).reshape(len(q), -1, 3, 3, len(back))
    for own, seen, rows, M in zip(q, visible, B, found, strict=True):
        V = covariance_of(cell, problem.model, own, ARM, seen)
        J = rows[:, seen].reshape(len(V), -1)
        expected = J.T @ np.linalg.solve(V, J)
        atol = 1e-9 * expected.max()
        np.testing.assert_allclose(back.T @ M @ back, expected, rtol=1e-8, atol=atol)
    still = Regressor.nominal(
        replace(cell, repeatability=None), problem.model, problem.regressor.values
    )
    ideal = replace(still, T=problem.regressor.T).information(q, visible)
    assert (np.trace(found, axis1=1, axis2=2) < np.trace(ideal, axis1=1, axis2=2)).all()


@pytest.mark.parametrize("criterion", ["task", "A", "D"])
@pytest.mark.parametrize(("arm", "again"), [(EXACT, 1), (ARM, 0), (ARM, 1)])
def test_no_plan_is_above_the_bound(criterion: str, arm: Repeatability, again: int) -> None:
    """Every plan of four of nine candidates; with one again, and all of five, where one is."""
    rng = np.random.default_rng(4)
    robot = random_robot(rng, 4)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ["base", "joint_compliance"])
    cell = replace(cell, repeatability=arm, load=Load(60.0, (0.1, 0.0, 0.1), np.pi))
    table = poses_at(rng.uniform(*robot.sample_limits().T, (9, 4)))
    plan = doe.design(visiting_again(cell, again), poses=4, criterion=criterion, candidates=table)
    T, seen, blocks = plan.problem.regressor.T, np.ones(3, dtype=bool), []
    for own, rows in zip(table.q, calib.observation(cell, table), strict=True):
        V = covariance_of(cell, plan.problem.model, own, arm, seen)
        blocks.append(T.T @ rows.T @ np.linalg.solve(V, rows) @ T)
    stops: list[tuple[int, ...]] = list(combinations(range(9), 4))
    if again:
        stops = [(*own, k) for own in stops for k in own] + list(combinations(range(9), 5))
    value = plan.problem.criterion.plain.value
    best = float(np.max(value(np.array([sum(blocks[i] for i in own) for own in stops]))))
    chosen = [int(np.abs(table.q - q).max(axis=1).argmin()) for q in plan.poses.q]
    assert plan.certificate.bound >= best * (1.0 - 1e-6)
    assert plan.certificate.value == pytest.approx(
        float(value(sum(blocks[i] for i in chosen))), rel=1e-6
    )
    if not again:
        assert plan.certificate.value == pytest.approx(best, rel=1e-6)
        assert plan.efficiency > 0.9


SCATTER = Repeatability(4e-5, 2e-4)


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, "base", "joint_offset"), load=None, design=Planned())


def nine(cell: Cell) -> tuple[Problem, Poses]:
    """Nine poses anywhere, which are all the candidates there are."""
    poses = named(np.random.default_rng(0).uniform(*cell.robot.sample_limits().T, (9, 6)))
    return problem_of(cell, Request(9, "D", candidates=poses)), poses


@pytest.mark.parametrize("count", [1, 3, 8])
def test_second_visits_are_over_the_day_and_never_at_once(cell: Cell, count: int) -> None:
    problem, given = nine(cell)
    poses, found = with_reapproaches(problem, given, count)
    assert sorted(poses.names) == sorted((*given.names, *found.again))
    assert found.again == tuple(f"{name}_again" for name in found.poses)
    assert list(found.poses) == sorted(set(found.poses))
    for name, again in zip(found.poses, found.again, strict=True):
        first, second = poses.names.index(name), poses.names.index(again)
        np.testing.assert_array_equal(poses.q[first], poses.q[second])
        assert second > first + 1
    assert len(np.unique(visits(poses))) == 9 + count


@pytest.mark.parametrize("count", [9, -1])
def test_too_many_are_refused(cell: Cell, count: int) -> None:
    said = f"{count} poses cannot be visited again: 8 of 9 can"
    with pytest.raises(CalibError, match=said):
        with_reapproaches(*nine(cell), count)


@pytest.mark.parametrize(("markers", "coordinates"), [(1, 3), (2, 5), (3, 6)])
def test_degrees_of_freedom_where_nothing_is_known_of_the_arm(
    cell: Cell, markers: int, coordinates: int
) -> None:
    _, found = with_reapproaches(*nine(first_markers(cell, markers)), 4)
    assert found.dof == 4 * coordinates
    assert found.error == pytest.approx(1.0 / np.sqrt(4 * coordinates))


def test_second_visits_lie_in_every_part_of_the_day_and_come_from_the_other_side(
    cell: Cell,
) -> None:
    """More joints than in visits at the end of the day, for little way."""

    def other_side(day: list[int]) -> float:
        side = np.sign(np.diff(q[day], axis=0, prepend=q[day][:1]))
        pairs = [np.flatnonzero(np.array(day) == pose) for pose in chosen]
        return float(np.mean([side[a] * side[b] < 0.0 for a, b in pairs]))

    figures = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        q = rng.uniform(*cell.robot.sample_limits().T, (24, 6))
        q = q[quickest_order(cell, q)]
        chosen = np.sort(rng.choice(23, 4, replace=False)).tolist()
        at_end, spread = [*range(24), *chosen], over_the_day(cell, q, chosen)
        assert sorted(spread) == sorted(at_end)
        assert all(pose in chosen for pose in spread if spread.count(pose) == 2)
        ways = [durations(cell, np.diff(q[day], axis=0)).sum() for day in (spread, at_end)]
        figures.append((other_side(spread), other_side(at_end), ways[0] / ways[1]))
        added, expected = [], 0
        for k, pose in enumerate(spread):
            added += [k] if pose != expected else []
            expected += pose == expected
        assert len({4 * k // len(spread) for k in added}) >= 3
    spread_side, end_side, longer = np.mean(figures, axis=0)
    assert spread_side > 0.45
    assert spread_side > 1.4 * end_side
    assert longer < 1.1


def test_they_are_spread(cell: Cell) -> None:
    """No two of four lie nearer than those of most fours that chance would take."""
    problem, poses = nine(cell)
    _, found = with_reapproaches(problem, poses, 4)
    low, high = cell.robot.sample_limits().T
    at = poses.q / (high - low)

    def nearest(chosen: np.ndarray) -> float:
        apart = np.abs(at[chosen][:, None] - at[chosen]).max(axis=-1)
        return float(apart[np.triu_indices(len(chosen), 1)].min())

    own = nearest(np.array([poses.names.index(name) for name in found.poses]))
    rng = np.random.default_rng(0)
    chance = [nearest(rng.choice(8, 4, replace=False)) for _ in range(200)]
    assert own > np.quantile(chance, 0.8)


@pytest.mark.long
def test_repeatability_is_found_as_well_as_promised(cell: Cell) -> None:
    """Days of measurement, their levels estimated: the scatter of the estimate is what was stated.

    Of forty days it is known to 11 % (1 / sqrt(2 * 39)), the mean to 2 %.
    """
    truth = replace(cell, repeatability=SCATTER)
    plan = unpolished(visiting_again(truth, 8), poses=12, **QUICK)
    assert plan.reapproaches is not None
    model = build(cell, plan.poses).model
    values, rng = np.zeros(len(model.parameters)), np.random.default_rng(11)
    found = []
    for _ in range(40):
        data = drawn_readings(model, values, plan.poses, cell.noise, rng, arm=SCATTER)
        result = calib.identify(cell, data)
        assert result.levels is not None
        assert result.scatter is not None
        tip = result.scatter.of_tip(result.levels.variances.approach)
        found.append(tip.translation / SCATTER.translation)
    assert np.mean(found) == pytest.approx(1.0, abs=0.12)
    assert 0.6 < np.std(found) / plan.reapproaches.error < 1.4


@pytest.mark.long
def test_the_command_and_the_cell_ask_for_them(tmp_path: Path) -> None:
    path = paper_cell(tmp_path)
    path.write_text(path.read_text().replace("\n[design] ", "\n[design]\nreapproaches = 4\n#"))
    assert load_cell(path).design.reapproaches == 4
    done = run(
        "design", path, "--poses", 15, "--candidates", 700, "--levels", "A2=5x3",
        "--reapproach", 3, "--json", tmp_path / "best.json", "-o", tmp_path / "best.csv",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "15 poses and 3 repeat visits" in said
    assert "They show the arm's repeatability to +-24 %" in said
    fields = json.loads((tmp_path / "best.json").read_text())
    assert fields["reapproaches"]["dof"] == pytest.approx(18.0)
    assert len(fields["poses"]) == 18
    plan = calib.load_plan(load_cell(path), tmp_path / "best.csv")
    assert set(fields["reapproaches"]["again"]) < set(plan.names)


# -- Orders against every permutation; times of a day by hand; poses that meet an obstacle


def costs(n: int, seed: int) -> Array:
    """Of the joint that goes farthest between random poses."""
    x = np.random.default_rng(seed).uniform(size=(n, 6))
    return np.asarray(np.abs(x[:, None] - x).max(axis=-1))


def along(cost: Array, order: Array) -> float:
    return float(cost[order[:-1], order[1:]].sum())


@pytest.mark.parametrize("n", range(1, 9))
def test_against_every_order(n: int) -> None:
    every = np.array(list(itertools.permutations(range(n))))
    for seed in range(10):
        cost = costs(n, seed)
        best = cost[every[:, :-1], every[:, 1:]].sum(axis=1).min()
        order = shortest_order(cost)
        assert sorted(order) == list(range(n))
        assert along(cost, order) == pytest.approx(best)


def test_it_is_much_shorter_than_the_given_order() -> None:
    for seed in range(3):
        cost = costs(60, seed)
        assert along(cost, shortest_order(cost)) < 0.6 * along(cost, np.arange(60))


def paced(cell: Cell, speeds: float = 1.0, **pace: float) -> Cell:
    robot = replace(cell.robot, speeds=np.full(cell.robot.dof, speeds))
    return replace(cell, robot=robot, pace=Pace(**{"speed": 1.0} | pace))


def test_seconds_of_a_motion() -> None:
    """One joint reaches 2 rad/s in half a second over half a radian; another never gets there."""
    robot = replace(
        planar(2).robot, speeds=np.array([2.0, 2.0]), accelerations=np.array([np.nan, 1.0])
    )
    cell = replace(planar(2), robot=robot, pace=Pace(speed=1.0))
    assert durations(cell, np.array([3.0, 0.0])) == pytest.approx(3.0 / 2.0 + 0.5)
    assert durations(cell, np.array([0.0, -1.0])) == pytest.approx(2.0)
    assert durations(cell, np.array([3.0, 1.0])) == pytest.approx(2.0)
    slow = replace(cell, pace=Pace(speed=0.1))
    assert durations(slow, np.array([3.0, 0.0])) == pytest.approx(3.0 / 0.2 + 0.5)


def test_the_time_of_a_day() -> None:
    cell = replace(paced(planar(1), settle=3.0, reading=7.0), load=Load(10.0, (0, 0, 0)))
    day = day_of(cell, poses_at(np.array([[0.0], [1.0], [3.0]])))
    moving, standing = (1.0 + 0.5) + (2.0 + 0.5), 3 * (3.0 + 2 * 7.0 + 2 * 120.0)
    assert day == pytest.approx(moving + standing)


def test_the_order_takes_little_time() -> None:
    cell = paced(planar(1))
    assert quickest_order(cell, np.array([[0.0], [2.0], [1.0], [3.0]])).tolist() == [0, 2, 1, 3]


def test_a_pose_in_an_obstacle_is_named() -> None:
    ball = {"type": "sphere", "center_mm": (0, 1500, 0), "radius_mm": 300.0}
    arm = planar(2, shapes=Shapes({"j1": (LINK,), "j2": (LINK,)}))
    q = np.array([[0.3, 0.0], [np.pi / 2, 0.0]])
    assert broken_at(designed(arm, obstacle=[ball]), q).tolist() == ["", "obstacle 1 (sphere)"]


def test_without_speeds_the_time_is_unknown() -> None:
    assert np.isnan(day_of(planar(2), poses_at(np.zeros((2, 2)))))
