"""Tunings found in data of a plain simulator, with intervals that hold, and handed on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Identification, Measurements
from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.errors import CalibError, EffectCannotAct
from calib.files.estimate import load_estimate
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from calib.prediction.estimate import estimate_of
from studies.results.estimate import Estimated
from tests.calib.effects.test_effects import seen
from tests.helpers import all_seen, cell_of, random_context, random_robot, with_effects
from tests.plain_arm import tips

SIGMA = 1e-5
MARKERS = np.array([[0.1, 0.0, 0.2], [-0.1, 0.1, 0.1], [0.0, -0.1, 0.15]])
R, P = so3_exp(np.array([0.3, -0.2, 0.5])), np.array([2.0, 1.0, 0.5])


def arm() -> Cell:
    return cell_of(random_robot(np.random.default_rng(1), 4), MARKERS, ("base", "tool"), SIGMA)


def session(cell: Cell, rng: np.random.Generator, count: int, timed: bool = False) -> Poses:
    q = rng.uniform(*cell.robot.limits.T, (count, cell.robot.dof))
    given = {"time": 5e4 + np.cumsum(rng.uniform(20.0, 40.0, count))} if timed else {}
    return with_moves(poses_at(q, **given))


def read(
    cell: Cell,
    poses: Poses,
    rng: np.random.Generator,
    dq: Array | float = 0.0,
    shift: Array | float = 0.0,
) -> Measurements:
    """Readings of an arm whose joints are off by dq (m, n) and whose readings by shift (m, 3)."""
    scene = random_context(rng, cell.robot, len(MARKERS))
    scene = replace(scene, markers=cell.markers)
    points = seen(scene, tips(scene.robot, poses.q + dq))
    points = points @ R.T + P + np.broadcast_to(shift, (len(poses), 3))[:, None]
    points = points + rng.normal(scale=SIGMA, size=points.shape)
    return all_seen(poses, points)


def ripple(cell: Cell, rng: np.random.Generator) -> tuple[Measurements, float]:
    poses, cycles = session(cell, rng, 50), rng.uniform(20.0, 400.0)
    dq = np.zeros_like(poses.q)
    dq[:, 1] = 6e-5 * np.cos(cycles * poses.q[:, 1] + rng.uniform(0.0, 6.0))
    return read(cell, poses, rng, dq), cycles


def warming(cell: Cell, rng: np.random.Generator) -> tuple[Measurements, float]:
    poses, tau = session(cell, rng, 50, timed=True), rng.uniform(200.0, 900.0)
    assert poses.time is not None
    left = np.exp(-(poses.time - poses.time[0]) / tau)
    return read(cell, poses, rng, shift=left[:, None] * [5e-5, -8e-5, 3e-5]), tau


def jump(cell: Cell, rng: np.random.Generator) -> tuple[Measurements, float]:
    poses, moment = session(cell, rng, 50), rng.uniform(5.0, 44.0)
    dq = np.zeros_like(poses.q)
    dq[:, 2] = 3e-5 * (np.arange(50) > moment)
    return read(cell, poses, rng, dq), moment


SCENES: dict[str, Callable[[Cell, np.random.Generator], tuple[Measurements, float]]] = {
    "gear_ripple:j2": ripple,
    "warm_up:instrument": warming,
    "step:j3": jump,
}


def tuning(result: Identification) -> tuple[float, float]:
    """Value and standard deviation of the one tuning."""
    (at,) = result.model.tunings
    return float(result.values[at]), float(result.std[at])


def trials(effect: str, count: int) -> Array:
    """Errors of the tuning in standard deviations."""
    cell = with_effects(arm(), "base", "tool", effect)
    pulls = []
    for seed in range(count):
        data, truth = SCENES[effect](cell, np.random.default_rng(seed))
        result = calib.identify(cell, data)
        assert result.status == "converged"
        value, std = tuning(result)
        pulls.append((value - truth) / std)
    return np.array(pulls)


@pytest.mark.long
@pytest.mark.parametrize("effect", ["gear_ripple:j2", "warm_up:instrument"])
def test_intervals_hold(effect: str) -> None:
    """Of 24 trials no more than four may lie outside, at 95 per cent in one case of two hundred."""
    pulls = trials(effect, 24)
    assert (np.abs(pulls) > 1.96).sum() <= 4
    assert np.median(np.abs(pulls)) < 1.2


@pytest.mark.long
def test_ripples_of_three_joints_are_found_at_once_beside_geometry() -> None:
    cell, rng = arm(), np.random.default_rng(3)
    poses = session(cell, rng, 90)
    cycles = np.array([201.3, 96.7, 320.2])
    dq = np.zeros_like(poses.q)
    dq[:, :3] = 5e-5 * np.cos(cycles * poses.q[:, :3] + [0.5, 1.0, 2.0])
    cell = with_effects(cell, "base", "tool", "geometry", "gear_ripple:j1,j2,j3")
    result = calib.identify(cell, read(cell, poses, rng, dq))
    at = result.model.tunings
    assert (np.abs(result.values[at] - cycles) < 4.0 * result.std[at]).all()
    assert (result.std[at] < 0.1).all()
    assert result.rms("fitted") == pytest.approx(np.sqrt(3.0) * SIGMA, rel=0.15)


def test_a_known_gear_ratio_leaves_two_lines_to_try() -> None:
    cell, rng = replace(arm(), gear_ratios={"j2": 80.6}), np.random.default_rng(4)
    poses = session(cell, rng, 30)
    dq = np.zeros_like(poses.q)
    dq[:, 1] = 2.2e-5 * np.sin(161.2 * poses.q[:, 1])
    data = read(cell, poses, rng, dq)
    known = calib.identify(with_effects(cell, "base", "tool", "gear_ripple:j2"), data)
    assert tuning(known)[0] == pytest.approx(161.2, abs=4.0 * tuning(known)[1])
    grid = known.model.effects[-1].grid(poses)  # type: ignore[attr-defined]
    np.testing.assert_allclose(grid, [80.6, 161.2])


@pytest.mark.long
def test_two_tunings_of_one_session() -> None:
    """The instrument warms while a joint jumps; rows in their order are the clock."""
    cell, rng = arm(), np.random.default_rng(5)
    poses = session(cell, rng, 60)
    count = np.arange(60.0)
    dq = np.zeros_like(poses.q)
    dq[:, 0] = 1e-4 * (count > 33.5)
    shift = np.exp(-count / 12.0)[:, None] * [1e-4, 0.0, -1e-4]
    cell = with_effects(cell, "base", "tool", "warm_up:instrument", "step:j1")
    result = calib.identify(cell, read(cell, poses, rng, dq, shift))
    tau, moment = result.model.tunings
    units = [result.model.parameters[i].unit for i in (tau, moment)]
    assert units == ["readings", "readings"]
    assert abs(result.values[tau] - 12.0) < 4.0 * result.std[tau]
    assert result.values[moment] == 33.5
    assert result.status == "converged"


def test_an_outlier_is_no_step() -> None:
    cell = arm()
    poses, rng, truth = session(cell, np.random.default_rng(6), 50), np.random.default_rng(6), 24.5
    dq = np.zeros_like(poses.q)
    dq[:, 2] = 3e-5 * (np.arange(50) > truth)
    data = read(cell, poses, rng, dq)
    points = data.points.copy()
    points[47] += 0.02
    result = calib.identify(
        with_effects(cell, "base", "tool", "step:j3"), replace(data, readings=points)
    )
    assert abs(tuning(result)[0] - truth) <= 2.0
    assert list(np.flatnonzero(result.fit.outlier)) == [47]


def test_held_out_poses_need_the_clock() -> None:
    cell, rng = arm(), np.random.default_rng(7)
    data, _ = jump(cell, rng)
    cell = with_effects(cell, "base", "tool", "step:j3")
    kept, held = data.split(0.2, np.random.default_rng(0))
    shared = calib.identify(cell, kept, heldout=held)
    assert shared.rms("heldout") == pytest.approx(np.sqrt(3.0) * SIGMA, rel=0.3)
    other, _ = jump(cell, rng)
    with pytest.raises(CalibError, match=r"held-out poses have no time, which step:j3 needs"):
        calib.identify(cell, data, heldout=other)


def test_nothing_to_scan_is_refused() -> None:
    cell, rng = arm(), np.random.default_rng(8)
    poses = session(cell, rng, 30)
    still = replace(poses, q=np.where([True, False, True, True], poses.q, 0.3))
    data = read(cell, still, rng)
    lost = calib.identify(with_effects(cell, "base", "tool", "gear_ripple:j2"), data)
    assert lost.status == "rank_deficient"
    silent = replace(data, poses=replace(data.poses, order=None))
    with pytest.raises(EffectCannotAct, match="step:j3 cannot act: the poses have no time"):
        calib.identify(with_effects(cell, "base", "tool", "step:j3"), silent)


@pytest.mark.parametrize("effect", SCENES)
def test_estimates_keep_their_tunings(effect: str, tmp_path: Path) -> None:
    cell = with_effects(arm(), "base", "tool", effect)
    data, _ = SCENES[effect](cell, np.random.default_rng(9))
    found = estimate_of(calib.identify(cell, data))
    assert not found.undetermined
    fields = {"command": "identify", "estimate": Estimated.of(found).model_dump(by_alias=True)}
    path = tmp_path / "result.json"
    path.write_text(json.dumps(fields))
    again = load_estimate(cell, path)
    np.testing.assert_allclose(
        again.model.predict(again.values, data.poses),
        found.model.predict(found.values, data.poses),
        atol=1e-12,
    )
    assert [e.initial[0] for e in again.model.effects[-1:]] == [tuning_of(found)]
    assert again.clock_unit == data.poses.clock_unit


def tuning_of(estimate: calib.Estimate) -> float:
    (at,) = estimate.model.tunings
    return float(estimate.values[at])


def test_targets_come_after_the_session() -> None:
    """A ripple is corrected where it is, a step has happened, and what was cold is warm."""
    cell, rng = arm(), np.random.default_rng(10)
    poses = session(cell, rng, 60)
    count = np.arange(60.0)
    dq = np.zeros_like(poses.q)
    dq[:, 0] = 3e-4 * (count > 30.5) + 2e-4 * np.exp(-count / 10.0)
    dq[:, 1] = 8e-5 * np.cos(150.0 * poses.q[:, 1])
    model = ("base", "tool", "warm_up:j1", "step:j1", "gear_ripple:j2")
    cell = with_effects(cell, *model)
    result = calib.identify(cell, read(cell, poses, rng, dq))
    targets = session(cell, rng, 5).q
    found = calib.compensate(cell, result, targets)
    expected = np.zeros_like(targets)
    expected[:, 0] = -3e-4
    expected[:, 1] = -8e-5 * np.cos(150.0 * targets[:, 1])
    np.testing.assert_allclose(found.correction, expected, atol=1.5e-5)
    assert any("warm_up:j1, step:j1 counts as after it" in note for note in found.notes)
