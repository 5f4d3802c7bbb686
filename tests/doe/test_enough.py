"""Half a plan measured: what is left of it, what is said now and at the end, and what then comes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from calib import (
    Cell,
    Identification,
    Measurements,
    Poses,
    identify,
    load_targets,
)
from calib.arrays import Array
from calib.cell import Repeatability
from calib.cell.targets import targets_of
from calib.errors import CalibError
from calib.model.covariance import accuracy
from calib.noise import Noise
from calib.poses import poses_at
from calib.prediction.estimate import fitted_of
from doe.forecast.coming import match
from doe.forecast.coming import whole_day as coming_day
from doe.forecast.enough import Enough, enough
from studies.research.truth import day as truth_day
from tests.day import PLAN_RIGID, cell_of_day, day, of_poses, whole_day
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


@pytest.mark.parametrize("case", ["as stated", "may scatter", "louder than stated", "an outlier"])
def test_now_is_what_identify_says(
    kr270: Cell, cell: Cell, full: Measurements, table_two: Poses, case: str
) -> None:
    own, data = cell, of_poses(full, SO_FAR, 15)
    if case == "may scatter":
        own = cell_of_day(kr270)
    if case == "louder than stated":
        data = of_poses(whole_day(cell, table_two, louder=3.0), SO_FAR, 15)
    if case == "an outlier":
        points = full.points.copy()
        points[3] += [2e-3, -1e-3, 1e-3]
        data = replace(full, readings=points)
    answer = enough(own, data)
    found = answer.found
    assert found is not None
    assert (found.undetected is not None) is (case == "may scatter")
    assert (found.noise.source == "residual") is (case == "louder than stated")
    assert np.flatnonzero(found.fit.outlier).tolist() == [3] * (case == "an outlier")
    (now,), (row,) = answer.steps, answer.rows()
    np.testing.assert_allclose(now.std, found.std, rtol=1e-6)
    assert answer.sigma == pytest.approx(found.noise.sigma)
    assert (row["task_rms_mm"], row["task_worst_mm"]) == (1e3 * now.task_rms, 1e3 * now.task_worst)
    if case != "may scatter":
        assert now.task_rms == pytest.approx(expected(own, found), rel=1e-9)


@pytest.mark.parametrize(
    "noise", [None, pytest.param(Noise(5e-6, 5e-6, 0.0, 2e-5), marks=pytest.mark.long)]
)
def test_the_end_is_what_identify_will_say_and_every_pose_helps(
    cell: Cell, table_two: Poses, noise: Noise | None
) -> None:
    """Where noise grows with range, too."""
    own = cell if noise is None else replace(cell, instruments=read_by(noise))
    full = whole_day(own, table_two)
    found, answer = identify(own, full), enough(own, of_poses(full, SO_FAR, 15), table_two)
    assert found.noise.source == "cell"
    assert not found.fit.outlier.any()
    np.testing.assert_allclose(answer.steps[-1].std, found.std, rtol=0.02)
    assert answer.steps[-1].task_rms == pytest.approx(expected(own, found), rel=0.02)
    assert answer.steps[-1].readings == len(full)
    assert all(after.task_rms < before.task_rms for before, after in pairwise(answer.steps))
    assert not any(step.open for step in answer.steps)


def test_a_model_of_time_goes_on_at_the_pace_of_the_data(cell: Cell, table_two: Poses) -> None:
    own = with_effects(cell, *PLAN_RIGID, "base_drift", "backlash:A3")
    own = replace(own, load=None, size_prior="off")
    full = whole_day(own, table_two)
    answer = enough(own, full.take(slice(0, 11)), table_two, goal=1e-9)
    assert not answer.fresh
    np.testing.assert_allclose(answer.steps[-1].std, identify(own, full).std, rtol=0.02)


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


@pytest.mark.long
def test_the_goal_is_met_where_the_figures_say(
    cell: Cell, half: Measurements, table_two: Poses, answer: Enough
) -> None:
    most = [step.task_most for step in answer.steps]
    assert all(step.task_most > step.task_rms for step in answer.steps)
    assert replace(answer, goal=1.01 * most[0]).needed == 0
    assert replace(answer, goal=1.0001 * most[3]).needed == 3
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


def renamed(poses: Poses) -> Poses:
    return replace(poses, names=tuple(f"x{i}" for i in range(len(poses))))


@pytest.mark.parametrize(
    ("index", "off", "named", "done", "said"),
    [
        ([3, 0, 7, 18, 15, 22], 0.0, False, 3, ""),
        ([3, 0, 7, 18, 15, 22], 9e-4, False, 3, ""),
        # All free readings come before the first loaded one.
        (range(17), 0.0, True, 2, ""),
        ([4, 19], 2.0, True, 1, "beside the plan's joints"),
        ([4, 19], 20.0, True, 0, "is it the right plan"),
    ],
)
def test_poses_are_known_by_their_joints_and_by_names_where_these_are_near(
    cell: Cell, full: Measurements, table_two: Poses,
    index: Sequence[int], off: float, named: bool, done: int, said: str,
) -> None:  # fmt: skip
    day = full.poses.take(np.array(index))
    day = replace(day if named else renamed(day), q=day.q + np.radians(off))
    found = match(cell, table_two, day)
    assert found.poses == done
    assert set(found.left) == set(range(30)) - set(index if done else ())
    assert said in "".join(found.warnings[:1])
    assert bool(said) is bool(found.warnings)
    assert len(match(cell, table_two.take([]), day).left) == 0
    with pytest.raises(CalibError, match="nothing was read yet"):
        enough(cell, full.take([]), table_two)


def test_a_reference_is_to_come_as_often_as_it_is_missing(cell: Cell, table_two: Poses) -> None:
    q = table_two.q[[0, 1, 2, 0, 3, 0]]
    plan = poses_at(q, ["ref1", "p1", "p2", "ref2", "p0", "ref3"])
    day = renamed(whole_day(cell, plan).poses.take([0, 1, 2, 3]))
    free = np.setdiff1d(np.arange(6), match(cell, plan, day).left)
    np.testing.assert_array_equal(free, [0, 1, 2, 3])
    # Read three times before the arm went on: one reading of the plan.
    thrice = renamed(day.take([0, 0, 0, 1]))
    free = np.setdiff1d(np.arange(6), match(cell, plan, thrice).left)
    np.testing.assert_array_equal(free, [0, 1])
    named = match(cell, plan, replace(thrice, names=("ref1", "ref2", "other", "p1")))
    np.testing.assert_array_equal(np.setdiff1d(np.arange(6), named.left), [0, 1, 3])


def test_what_is_left_is_known_by_its_pose_in_whatever_turn_it_is_read(
    cell: Cell, full: Measurements, table_two: Poses
) -> None:
    """An arm whose scatter is known reads each pose free and loaded in one stay."""
    done = match(cell, table_two, full.poses.take(slice(0, 17)))
    left = done.left
    assert (done.poses, done.begun) == (2, 13)
    for arm in (cell, replace(cell, repeatability=Repeatability(3e-5, 1e-4))):
        day, pose = coming_day(arm, full.take(np.arange(17)), table_two, left)
        assert len(day) == 30
        np.testing.assert_array_equal(pose[:17], -1)
        np.testing.assert_allclose(day.poses.q[17:], table_two.q[pose[17:]])
        # All free ones are read, and two loaded ones.
        assert sorted(pose[17:]) == list(range(2, 15))
        assert (day.poses.wrench[17:, 2] < -100.0).all()


def warming(rng: np.random.Generator) -> Callable[[Array], Array]:
    """Zeros of the joints that wander through the day, and stay where they were at its end."""
    far, tau = rng.normal(size=6) * 4e-5, rng.uniform(0.3, 2.0)

    def truth(q: Array) -> Array:
        at = np.arange(len(q)) / 40 if len(q) == 40 else np.ones(len(q))
        return np.asarray(q + far * (1.0 - np.exp(-at / tau))[:, None])

    return truth


def sagging(rng: np.random.Generator) -> Callable[[Array], Array]:
    """Shoulder and elbow that give way as no link of the model does."""
    size = rng.uniform(0.5e-4, 3e-4, 2)

    def truth(q: Array) -> Array:
        moved, arm = q.copy(), q[:, 1] + q[:, 2]
        moved[:, 1] += size[0] * np.sin(2.0 * q[:, 1]) + size[1] * np.cos(arm)
        moved[:, 2] += size[1] * np.sin(arm) * np.abs(np.sin(arm))
        return moved

    return truth


def came_of(cell: Cell, answer: Enough, truth: truth_day.Day) -> float:
    """By how much fresh poses then miss, RMS, m."""
    assert answer.found is not None
    targets, _ = load_targets(cell, cell.path.with_name("targets.csv"))
    off = answer.found.predict(targets) - truth.approached
    return float(np.sqrt((off**2).sum(axis=-1).mean()))


@pytest.mark.long
@pytest.mark.parametrize("effect", [warming, sagging])
def test_what_is_called_reached_comes(
    effect: Callable[[np.random.Generator], Callable[[Array], Array]],
) -> None:
    """Once in twenty may be wrong: of six days, two would be thirty to one against that."""
    wrong, promised = 0, []
    for index in range(6):
        errs = effect(np.random.default_rng([index, 77]))
        cell, data, _, truth = day("6R", seed=5, index=index, poses=40, truth=errs)
        answer = enough(cell, data)
        came = came_of(cell, answer, truth)
        wrong += came > answer.steps[0].task_most
        promised.append(came / answer.steps[0].task_rms)
        assert answer.steps[0].task_most >= answer.lacking.missed
    assert wrong <= 1
    assert np.sqrt(np.mean(np.square(promised))) < 1.2


@pytest.mark.long
def test_what_the_arm_scatters_is_never_reached() -> None:
    """An arm of 0.03 mm in MuJoCo: part of what is expected, and no number of poses goes below."""
    cell, data, _, truth = day("6R", index=1, scatter=3e-5, poses=40)
    answer = enough(cell, data, goal=2e-5)
    now = answer.steps[0]
    assert answer.beyond_reach
    assert answer.needed is None
    assert not answer.fresh
    assert now.task_rms == pytest.approx(np.hypot(now.from_parameters, answer.lacking.rms))
    came = came_of(cell, answer, truth)
    assert now.task_rms == pytest.approx(came, rel=0.2)
    assert came <= now.task_most
    assert enough(cell, data, goal=1.01 * now.task_most).needed == 0
    assert not enough(cell, data, goal=1.1 * answer.lacking.rms).beyond_reach


@pytest.mark.long
def test_a_day_that_lacks_nothing_is_promised_nothing_more() -> None:
    cell, data, _, truth = day("6R", seed=5, index=0, poses=40)
    answer = enough(cell, data)
    came = came_of(cell, answer, truth)
    assert answer.lacking.rms == 0.0
    assert answer.steps[0].task_rms == pytest.approx(came, rel=0.4)
    assert answer.steps[0].task_most < 2.0 * came


def test_held_out_poses_are_what_was_measured_there() -> None:
    sags = sagging(np.random.default_rng(4))
    cell, data, _, _ = day("6R", seed=5, index=4, poses=45, truth=sags)
    own, held = data.take(slice(0, 30)), data.take(slice(30, 45))
    answer = enough(cell, own, heldout=held)
    assert answer.found is not None
    off = held.points - answer.found.predict(held.poses)
    missed, fit = float((off**2).sum(axis=-1).mean()), fitted_of(answer.found)
    assert answer.lacking.missed == pytest.approx(np.sqrt(missed - 3.0 * fit.sigma**2))
    assert answer.steps[0].task_most >= answer.lacking.missed
    assert enough(cell, own, heldout=held, goal=0.99 * answer.lacking.missed).needed is None
