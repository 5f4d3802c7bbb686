"""Poses that are visited again: which, when, by default or not, what they tell and what they cost."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import doe
from calib import Cell
from calib.cell import Repeatability
from calib.cell.planned import AskedLevels, Planned
from calib.errors import CalibError
from calib.files.cell import load_cell
from calib.model.build import build
from calib.poses import poses_at
from calib.poses.moves import visits
from calib.simulation import drawn_readings
from doe.assess import assess
from doe.order import durations, over_the_day, quickest_order, with_reapproaches
from doe.plan import named
from doe.request import request_of
from studies.results.design import DesignResult
from tests.doe.plans import unpolished, visiting_again
from tests.helpers import MADE_FROM, cell_of, first_markers, random_robot, with_effects
from tests.studies.command_line import paper_cell, run

QUICK: dict[str, Any] = {"candidates": 300, "criterion": "D"}
FEW: dict[str, Any] = QUICK | {"candidates": 250}
ARM = Repeatability(4e-5, 2e-4)


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    return replace(with_effects(kr270, "base", "joint_offset"), load=None, design=Planned())


@pytest.fixture(scope="module")
def plain(cell: Cell) -> doe.Design:
    return unpolished(cell, poses=9, **QUICK)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_second_visits_are_over_the_day_and_never_at_once(plain: doe.Design, count: int) -> None:
    poses, found = with_reapproaches(plain.problem, plain.poses, count)
    assert sorted(poses.names) == sorted((*plain.poses.names, *found.again))
    assert found.again == tuple(f"{name}_again" for name in found.poses)
    assert list(found.poses) == sorted(set(found.poses))
    for name, again in zip(found.poses, found.again, strict=True):
        first, second = poses.names.index(name), poses.names.index(again)
        np.testing.assert_array_equal(poses.q[first], poses.q[second])
        assert second > first + 1
    assert len(np.unique(visits(poses))) == 9 + count


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


def test_they_are_spread(plain: doe.Design) -> None:
    """No two of four lie nearer than those of most fours that chance would take."""
    _, found = with_reapproaches(plain.problem, plain.poses, 4)
    low, high = plain.problem.cell.robot.sample_limits().T
    at = plain.poses.q / (high - low)

    def nearest(chosen: np.ndarray) -> float:
        apart = np.abs(at[chosen][:, None] - at[chosen]).max(axis=-1)
        return float(apart[np.triu_indices(len(chosen), 1)].min())

    own = nearest(np.array([plain.poses.names.index(name) for name in found.poses]))
    rng = np.random.default_rng(0)
    chance = [nearest(rng.choice(8, 4, replace=False)) for _ in range(200)]
    assert own > np.quantile(chance, 0.8)


@pytest.mark.long
def test_they_count_as_what_they_are(cell: Cell) -> None:
    known = replace(cell, repeatability=ARM)
    plan = unpolished(visiting_again(known, 4), poses=9, **QUICK)
    once = [k for k, name in enumerate(plan.poses.names) if not name.endswith("_again")]
    alone = assess(plan.problem, plan.poses.q[once])
    assert (plan.assessment.std < alone.std).all()
    assert (plan.assessment.std > alone.std / np.sqrt(2.0)).all()
    assert alone.value < plan.value == pytest.approx(plan.assessment.value)
    assert plan.value <= plan.bound


@pytest.mark.long
@pytest.mark.parametrize(("markers", "coordinates"), [(1, 3), (2, 5), (3, 6)])
def test_degrees_of_freedom_where_nothing_is_known_of_the_arm(
    cell: Cell, markers: int, coordinates: int
) -> None:
    few = first_markers(cell, markers)
    found = unpolished(visiting_again(few, 4), poses=9, **QUICK).reapproaches
    assert found is not None
    assert found.dof == pytest.approx(4 * coordinates)
    assert found.common == pytest.approx(1.0 / np.sqrt(8 * coordinates))
    if markers < 3:
        assert np.isnan([found.translation, found.rotation]).all()
    else:
        assert found.translation == pytest.approx(1.0 / np.sqrt(24.0))


@pytest.mark.long
def test_repeatability_is_found_as_well_as_promised(cell: Cell) -> None:
    """Days of measurement, their levels estimated: the scatter of the estimate is what was stated."""
    truth = replace(cell, repeatability=ARM)
    plan = unpolished(visiting_again(truth, 8), poses=12, **QUICK)
    assert plan.reapproaches is not None
    model = build(cell, plan.poses).model
    values, rng = np.zeros(len(model.parameters)), np.random.default_rng(11)
    found = []
    for _ in range(120):
        data = drawn_readings(model, values, plan.poses, cell.noise, rng, arm=ARM)
        result = calib.identify(cell, data)
        assert result.levels is not None
        assert result.scatter is not None
        tip = result.scatter.of_tip(result.levels.variances.approach)
        found.append(tip.translation / ARM.translation)
    assert np.mean(found) == pytest.approx(1.0, abs=0.12)
    assert 0.6 < np.std(found) / plan.reapproaches.translation < 1.4


@pytest.mark.long
def test_the_command_and_the_cell_ask_for_them(tmp_path: Path) -> None:
    path = paper_cell(tmp_path)
    path.write_text(path.read_text().replace("\n[design] ", "\n[design]\nreapproaches = 4\n#"))
    assert request_of(load_cell(path), poses=15).reapproaches == 4
    done = run(
        "design", path, "--poses", 15, "--candidates", 700, "--levels", "A2=5x3",
        "--reapproach", 3, "--json", tmp_path / "best.json", "-o", tmp_path / "best.csv",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "15 poses and 3 repeat visits" in said
    assert "They show the arm's repeatability to +-24 % (translation) and +-24 % (rotation)" in said
    fields = json.loads((tmp_path / "best.json").read_text())
    assert fields["reapproaches"]["dof"] == pytest.approx(18.0)
    assert len(fields["poses"]) == 18
    plan = calib.load_plan(load_cell(path), tmp_path / "best.csv")
    assert set(fields["reapproaches"]["again"]) < set(plan.names)


def test_too_many_are_refused(cell: Cell, plain: doe.Design) -> None:
    with pytest.raises(CalibError, match="9 poses cannot be visited again: 8 of 9 can"):
        with_reapproaches(plain.problem, plain.poses, 9)
    with pytest.raises(CalibError, match="-1 poses cannot be visited again"):
        unpolished(visiting_again(cell, -1), poses=7, **QUICK)
    assert DesignResult.of(plain, plain.problem.cell, MADE_FROM).reapproaches is None


# -- second visits by default -----------------------------------------------------------------


@pytest.mark.parametrize(("poses", "again"), [(19, 0), (20, 4), (40, 4), (55, 6), (100, 10)])
def test_a_tenth_at_least_four_of_twenty_poses_or_more(cell: Cell, poses: int, again: int) -> None:
    asked = request_of(cell, poses=poses)
    assert (asked.poses, asked.reapproaches) == (poses - again, again)


def test_none_where_something_speaks_against_it(cell: Cell) -> None:
    q = np.random.default_rng(0).uniform(*cell.robot.sample_limits().T, (6, 6))
    back = named(np.concatenate([q, q[:2]]))
    asked = partial(request_of, cell, poses=30)
    assert asked(extend=named(q)).reapproaches == 4
    assert asked(extend=back).reapproaches == 0
    assert asked(discriminate=("backlash:A2", "backlash:A3")).reapproaches == 0
    assert asked(levels={"A2": AskedLevels(10, 3)}).reapproaches == 0
    repeated = replace(cell, design=Planned(repeats=True))
    assert request_of(repeated, poses=30).reapproaches == 0
    for known in (Repeatability(2e-5, 0.0), Repeatability(0.0, 0.0)):
        assert request_of(replace(cell, repeatability=known), poses=30).reapproaches == 0


@pytest.fixture(scope="module")
def usual(cell: Cell) -> doe.Design:
    return unpolished(cell, poses=20, **FEW)


def test_they_are_among_the_poses_that_were_asked_for(cell: Cell, usual: doe.Design) -> None:
    """The plan is that of fewer poses, some of them visited again with others in between."""
    assert usual.reapproaches is not None
    assert not usual.reapproaches.asked
    assert len(usual.poses) == 20
    counts = np.bincount(visits(usual.poses))
    assert counts.max() == 1
    assert sorted(np.bincount(usual.poses.configuration)) == [1] * 12 + [2] * 4
    asked = unpolished(visiting_again(cell, 4), poses=16, **FEW)
    np.testing.assert_array_equal(usual.poses.q, asked.poses.q)
    assert (usual.value, usual.bound) == (asked.value, asked.bound)
    assert asked.reapproaches is not None
    assert asked.reapproaches.asked


def test_how_to_plan_without_them_is_said(cell: Cell, usual: doe.Design) -> None:
    without = unpolished(visiting_again(cell, 0), poses=20, **FEW)
    assert without.reapproaches is None
    assert len(np.unique(without.poses.configuration)) == 20
    assert not any("repeat visits" in note for note in without.notes)
    assert any("--reapproach 0" in note for note in usual.notes)
    assert usual.assessment.task_rms < 1.1 * without.assessment.task_rms


def test_none_where_the_candidates_are_the_plan(cell: Cell) -> None:
    q = np.random.default_rng(1).uniform(*cell.robot.sample_limits().T, (20, 6))
    plan = unpolished(cell, poses=20, **{**FEW, "candidates": poses_at(q)})
    np.testing.assert_allclose(np.sort(plan.poses.q, axis=0), np.sort(q, axis=0))


@pytest.mark.parametrize("criterion", ["task", "A", "D"])
@pytest.mark.parametrize("repeats", [False, True], ids=["once", "repeated"])
def test_no_plan_of_as_many_stops_is_above_the_bound(criterion: str, repeats: bool) -> None:
    """Every plan of four of nine candidates with one of them again, and every plan of five."""
    rng = np.random.default_rng(4)
    robot = random_robot(rng, 4)
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ["base", "joint_offset"])
    table = poses_at(rng.uniform(*robot.sample_limits().T, (9, 4)))
    again = replace(cell, design=Planned(repeats=repeats, reapproaches=1))
    plan = doe.design(again, poses=4, criterion=criterion, candidates=table)
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
    plan = unpolished(one, poses=20, **FEW)
    assert 48 < len(plan.problem.model.parameters) <= 60
    assert plan.reapproaches is None
    assert len(np.unique(plan.poses.configuration)) == 20
    assert np.isfinite(assess(plan.problem, plan.poses.q).std).all()
