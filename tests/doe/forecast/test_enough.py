"""Half a plan measured: what is said now, next, and at the end, against identifications themselves."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from calib import (
    Cell,
    Identification,
    Measurements,
    Poses,
    identify,
    load_cell,
    load_measurements,
    load_targets,
)
from calib.cell import Repeatability
from calib.cell.targets import targets_of
from calib.model.covariance import accuracy
from calib.noise import Noise
from doe.forecast.enough import Enough, enough
from studies.research.truth.day import Setting, draw_day, write_day
from tests.doe.forecast.day import RIGID, cell_of_day, of_poses, whole_day
from tests.helpers import read_by, with_effects

SO_FAR = [2, 5, 8, 14]


@pytest.fixture(scope="module")
def cell(kr270: Cell) -> Cell:
    """Of an arm that is known to repeat: else more poses leave less of its scatter likely."""
    return replace(cell_of_day(kr270), repeatability=Repeatability(0.0, 0.0))


@pytest.fixture(scope="module")
def full(cell: Cell, table_two: Poses) -> Measurements:
    return whole_day(cell, table_two)


@pytest.fixture(scope="module")
def half(full: Measurements) -> Measurements:
    return of_poses(full, SO_FAR, 15)


@pytest.fixture(scope="module")
def answer(cell: Cell, half: Measurements, table_two: Poses) -> Enough:
    return enough(cell, half, table_two)


def expected(cell: Cell, found: Identification) -> float:
    rms, _ = accuracy(found.model, found.values, found.knowledge, *targets_of(cell))
    return rms


def test_now_is_what_identify_says(cell: Cell, half: Measurements, answer: Enough) -> None:
    found = identify(cell, half)
    assert answer.steps[0].task_rms == pytest.approx(expected(cell, found), rel=1e-9)
    np.testing.assert_allclose(answer.steps[0].std, found.std, rtol=1e-6)
    assert answer.sigma == pytest.approx(found.noise.sigma)


def test_now_is_what_identify_says_of_an_arm_that_may_scatter(
    kr270: Cell, half: Measurements
) -> None:
    own = cell_of_day(kr270)
    found = identify(own, half)
    assert found.undetected is not None
    np.testing.assert_allclose(enough(own, half).steps[0].std, found.std, rtol=1e-6)


def test_the_end_is_what_identify_will_say(cell: Cell, full: Measurements, answer: Enough) -> None:
    found = identify(cell, full)
    assert found.noise.source == "cell"
    assert not found.fit.outlier.any()
    np.testing.assert_allclose(answer.steps[-1].std, found.std, rtol=0.02)
    assert answer.steps[-1].task_rms == pytest.approx(expected(cell, found), rel=0.02)
    assert answer.steps[-1].readings == len(full)


@pytest.mark.long
def test_the_next_pose_is_the_best_of_all(
    cell: Cell, full: Measurements, table_two: Poses, answer: Enough
) -> None:
    """Every pose still to come is tried: measured, identified, and judged by that."""
    rest = [i for i in range(15) if i not in SO_FAR]
    tried = {
        table_two.names[i]: expected(cell, identify(cell, of_poses(full, [*SO_FAR, i], 15)))
        for i in rest
    }
    best = min(tried, key=lambda name: tried[name])
    assert answer.steps[1].pose == best
    assert answer.steps[1].task_rms == pytest.approx(tried[best], rel=0.01)
    assert max(tried.values()) > 1.05 * tried[best]
    assert {step.pose for step in answer.steps[1:]} == set(tried)


def test_every_further_pose_helps(answer: Enough) -> None:
    rms = [step.task_rms for step in answer.steps]
    assert all(after < before for before, after in pairwise(rms))
    assert not any(step.open for step in answer.steps)


@pytest.mark.long
def test_the_goal_is_met_where_the_figures_say(
    cell: Cell, half: Measurements, table_two: Poses, answer: Enough
) -> None:
    most = [step.task_most for step in answer.steps]
    assert all(step.task_most > step.task_rms for step in answer.steps)
    assert enough(cell, half, table_two, goal=1.01 * most[0]).needed == 0
    assert enough(cell, half, table_two, goal=1.0001 * most[3]).needed == 3
    beyond = enough(cell, half, table_two, goal=0.95 * most[-1])
    assert beyond.needed is None
    assert beyond.fresh_needed == len(beyond.fresh) >= 1
    assert beyond.fresh[-1].task_most <= 0.95 * most[-1]
    if beyond.fresh_needed > 1:
        assert beyond.fresh[-2].task_most > 0.95 * most[-1]
    assert beyond.fresh[0].readings == len(half) + 2 * 11 + 2
    never = enough(cell, half, table_two, goal=1e-9)
    assert never.fresh_needed is None
    assert len(never.fresh) == 30


def test_the_noise_is_that_of_the_data(cell: Cell, table_two: Poses, answer: Enough) -> None:
    loud = enough(cell, of_poses(whole_day(cell, table_two, louder=3.0), SO_FAR, 15), table_two)
    assert loud.found is not None
    assert loud.found.noise.source == "residual"
    ratio = loud.sigma / answer.sigma
    assert ratio == pytest.approx(3.0, rel=0.25)
    assert loud.steps[-1].task_rms == pytest.approx(ratio * answer.steps[-1].task_rms, rel=0.02)


@pytest.mark.long
def test_noise_that_grows_with_range_is_foreseen(cell: Cell, table_two: Poses) -> None:
    far = replace(cell, instruments=read_by(Noise(5e-6, 5e-6, 0.0, 2e-5)))
    full = whole_day(far, table_two)
    found = identify(far, full)
    assert found.noise.source == "cell"
    answer = enough(far, of_poses(full, SO_FAR, 15), table_two)
    np.testing.assert_allclose(answer.steps[-1].std, found.std, rtol=0.02)


def test_an_outlier_counts_nothing(cell: Cell, full: Measurements, table_two: Poses) -> None:
    points = full.points.copy()
    points[3] += [2e-3, -1e-3, 1e-3]
    answer = enough(cell, replace(full, readings=points), table_two)
    assert answer.found is not None
    assert list(np.flatnonzero(answer.found.fit.outlier)) == [3]
    np.testing.assert_allclose(answer.steps[0].std, answer.found.std, rtol=1e-6)


def test_what_is_open_now_is_said_to_close(
    cell: Cell, full: Measurements, table_two: Poses
) -> None:
    """Only free readings so far: nothing tells of the compliances, and identify says so."""
    free = enough(cell, full.take(slice(0, 15)), table_two, goal=1e-4)
    assert free.found is None or free.found.status == "rank_deficient"
    assert free.steps[0].open
    assert all(name.startswith("joint_compliance") for name in free.steps[0].open)
    assert not free.steps[-1].open
    assert free.needed is not None
    assert free.needed > 0
    few = enough(cell, of_poses(full, [0], 15), table_two)
    assert "too few poses" in few.why
    assert few.steps[0].open


def test_without_a_plan_only_now_is_known(cell: Cell, half: Measurements, answer: Enough) -> None:
    alone = enough(cell, half, goal=1e-4)
    assert len(alone.steps) == 1
    assert alone.steps[0].task_rms == pytest.approx(answer.steps[0].task_rms, rel=1e-9)


def test_a_model_of_time_goes_on_at_the_pace_of_the_data(kr270: Cell, table_two: Poses) -> None:
    cell = replace(with_effects(cell_of_day(kr270), *RIGID, "base_drift", "backlash:A3"), load=None)
    cell = replace(cell, size_prior="off", repeatability=Repeatability(0.0, 0.0))
    full = whole_day(cell, table_two)
    found = identify(cell, full)
    answer = enough(cell, full.take(slice(0, 11)), table_two, goal=1e-9)
    assert not answer.fresh
    np.testing.assert_allclose(answer.steps[-1].std, found.std, rtol=0.02)


@pytest.mark.long
def test_what_the_arm_scatters_is_never_reached(tmp_path: Path) -> None:
    """An arm of 0.03 mm in MuJoCo: part of what is expected, and no number of poses goes below."""
    day = draw_day(Setting("6R", 3e-5, 1, 40, 3), 1, 0)
    write_day(tmp_path, day)
    cell = load_cell(tmp_path / "cell.toml")
    data = load_measurements(cell, tmp_path / "measurements.csv")
    answer = enough(cell, data, goal=2e-5)
    now = answer.steps[0]
    assert answer.beyond_reach
    assert answer.needed is None
    assert not answer.fresh
    assert now.task_rms == pytest.approx(np.hypot(now.from_parameters, answer.lacking.rms))
    assert answer.found is not None
    poses, _ = load_targets(cell, tmp_path / "targets.csv")
    off = answer.found.predict(poses) - day.approached
    came = float(np.sqrt((off**2).sum(axis=-1).mean()))
    assert now.task_rms == pytest.approx(came, rel=0.2)
    assert came <= now.task_most
    assert enough(cell, data, goal=1.01 * now.task_most).needed == 0
    assert not enough(cell, data, goal=1.1 * answer.lacking.rms).beyond_reach
