"""Cases at the edge: flat arms, few poses, gross errors, arms too soft to stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Measurements
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.errors import CalibError
from tests.calib.identification.test_identify import (
    MARKERS,
    RIGID,
    day,
    measured,
    random_configurations,
)
from tests.helpers import cell_of, random_robot, with_effects


def scara(rng: np.random.Generator) -> Robot:
    """Three parallel revolute axes and a slide along them."""
    robot = random_robot(rng, 4, prismatic=(3,))
    origins = robot.origins.copy()
    origins[:, :3, :3] = np.eye(3)
    return replace(robot, axes=np.tile([0.0, 0.0, 1.0], (4, 1)), origins=origins)


def planar(rng: np.random.Generator) -> Robot:
    robot = random_robot(rng, 2)
    origins = robot.origins.copy()
    origins[:, :3, :3] = np.eye(3)
    return replace(robot, axes=np.tile([0.0, 0.0, 1.0], (2, 1)), origins=origins)


@pytest.mark.parametrize("arm", [scara, planar, lambda rng: random_robot(rng, 1)])
@pytest.mark.parametrize("approach", ["points", "pose"])
def test_arms_whose_base_and_markers_hide_each_other(arm, approach: str) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        cell = cell_of(arm(rng), MARKERS, RIGID)
        data, _ = measured(cell, random_configurations(cell, rng, 30), rng, size=0.3)
        result = calib.identify(cell, data, approach=approach)  # type: ignore[arg-type]
        assert result.status == "converged"
        assert result.rms("fitted") < 2e-5 * np.sqrt(3)


def test_full_pose_with_hidden_markers_is_not_biased(kr270: Cell) -> None:
    rng = np.random.default_rng(0)
    markers = np.vstack([MARKERS, [[0.3, 0.05, 0.1]]])
    cell = cell_of(kr270.robot, np.zeros((4, 3)), RIGID)
    data, _ = measured(replace(cell, markers=markers), random_configurations(cell, rng, 40), rng)
    seen = np.ones(data.seen.shape, dtype=bool)
    seen[np.arange(40), rng.integers(0, 4, 40)] = False
    hidden = replace(data, seen=seen, readings=data.points * seen[..., None])
    result = calib.identify(cell, hidden, approach="pose")
    assert result.noise.source == "cell"
    assert result.rms("fitted") < 2e-5 * np.sqrt(3)


def test_poses_without_orientation_are_named(kr270: Cell) -> None:
    cell, data, _ = day(kr270, 1, 40, MARKERS)
    seen = data.seen.copy()
    seen[[3, 8], 0] = False
    result = calib.identify(cell, replace(data, seen=seen), approach="pose")
    assert result.unused == (data.poses.names[3], data.poses.names[8])
    assert result.dof == 3 * int(seen.sum() - 4) - result.rank


def shifted(data: Measurements, poses: list[int], by: Array) -> Measurements:
    points = data.points.copy()
    points[poses] += by
    return replace(data, readings=points)


@pytest.mark.sampled
@pytest.mark.parametrize(("count", "size"), [(15, 2e-3), (15, 2.0), (28, 1e-1)])
def test_a_wrong_pose_among_few_is_found(kr270: Cell, count: int, size: float) -> None:
    rng = np.random.default_rng(count)
    cell = cell_of(kr270.robot, MARKERS, RIGID)
    for _ in range(2):
        data, _ = measured(cell, random_configurations(cell, rng, count), rng)
        bad = int(rng.integers(count))
        result = calib.identify(cell, shifted(data, [bad], rng.normal(size=3) * size))
        assert list(np.flatnonzero(result.fit.outlier)) == [bad]
        assert result.rms("fitted") < 2e-5 * np.sqrt(3)


@pytest.mark.long
def test_gross_errors_do_not_bend_an_elastic_arm(kr270: Cell) -> None:
    """Six poses of sixty are metres off; compliances must not follow them."""
    cell = with_effects(
        cell_of(kr270.robot, MARKERS, RIGID), *RIGID, "joint_compliance:A2,A3,A4,A5"
    )
    rng = np.random.default_rng(0)
    data, _ = measured(cell, random_configurations(cell, rng, 60), rng, size=0.3)
    bad = list(rng.choice(60, 6, replace=False))
    result = calib.identify(cell, shifted(data, bad, rng.normal(size=(6, 1, 3)) * 3.0))
    assert result.status == "converged"
    assert set(bad) <= set(np.flatnonzero(result.fit.outlier))
    assert result.rms("fitted") < 3e-5 * np.sqrt(3)


def test_a_station_whose_only_pose_is_wrong(kr270: Cell) -> None:
    """Its base then hangs on that pose alone: the result says so and nothing fails."""
    rng = np.random.default_rng(2)
    cell = cell_of(kr270.robot, MARKERS, RIGID)
    station = np.r_[np.zeros(34, dtype=int), 1]
    poses = random_configurations(cell, rng, 35, station=station, stations=("north", "south"))
    data, _ = measured(cell, poses, rng)
    points = data.points.copy()
    points[34, 0] += 0.3
    result = calib.identify(cell, replace(data, readings=points))
    assert list(np.flatnonzero(result.fit.outlier)) == [34]
    assert result.status == "rank_deficient"
    lost = {name for entry in result.unidentifiable for name in entry.names}
    assert lost == {f"base:south.{c}" for c in ("x", "y", "z", "rx", "ry", "rz")}
    assert result.rms("fitted") < 2e-5 * np.sqrt(3)


def test_an_arm_too_soft_to_stand_is_refused(kr270: Cell) -> None:
    cell = with_effects(kr270, "joint_compliance:A2")
    with pytest.raises(CalibError, match="finds no equilibrium"):
        calib.predict(cell, np.zeros((1, 6)), {"joint_compliance:A2.compliance": 1e-3})


@pytest.mark.long
def test_nonsense_units_are_not_called_a_success(kr270: Cell) -> None:
    cell, data, _ = day(kr270, 3, 40, MARKERS)
    with pytest.raises(CalibError, match="check the units"):
        calib.identify(cell, replace(data, readings=data.points * 2e3))
    result = calib.identify(cell, replace(data, readings=data.points * 9.0))
    assert any("check units" in text for text in result.warnings)


def test_held_out_points_keep_their_own_deviation(kr270: Cell) -> None:
    cell, data, rng = day(kr270, 5, 40, MARKERS)
    points = data.points[:20] + rng.normal(size=(20, 3, 3)) * 2e-4
    held = replace(data.take(slice(0, 20)), readings=points, sigma=np.full((20, 3), 2e-4))
    result = calib.identify(cell, data.take(slice(20, None)), heldout=held)
    assert not result.heldout.outlier.any()
