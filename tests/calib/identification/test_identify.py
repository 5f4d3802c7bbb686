"""Identification on simulated data: from nothing, by any road, with what real tables contain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib import Cell, Measurements, Poses
from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.errors import CalibError, TooFewPoses
from calib.identification.start import initial_values
from calib.model.build import build
from calib.noise import Noise
from calib.poses import poses_at
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_robot, simulated, with_effects

MARKERS = np.array(
    [[0.2792, -0.0164, -0.0919], [0.2792, -0.0252, 0.0961], [0.2818, 0.1305, 0.0056]]
)
RIGID = ("base", "tool", "geometry")


def measured(
    cell: Cell, poses: Poses, rng: np.random.Generator, size: float = 1.0, noise: float = 1e-5
) -> tuple[Measurements, Array]:
    """Data of a random truth: base anywhere, geometry of some sizes, markers far from the guess."""
    model = build(cell, poses).model
    truth = model.sizes * rng.normal(size=len(model.parameters)) * size
    for effect, part in model.parts:
        if effect.kind == "base":
            axis = rng.normal(size=3)
            turn = axis / np.linalg.norm(axis) * rng.uniform(0, np.pi)
            truth[part] = np.concatenate([rng.uniform(-8, 8, 3), turn])
        if effect.kind == "tool":
            truth[part] = rng.uniform(-0.2, 0.2, len(effect.parameters))
        if "compliance" in effect.kind or effect.kind == "stiffness_vs_angle":
            truth[part] = np.abs(truth[part]) + model.sizes[part]
    return drawn_readings(model, truth, poses, Noise.isotropic(noise), rng), truth


def random_configurations(
    cell: Cell, rng: np.random.Generator, count: int, **given: object
) -> Poses:
    low, high = cell.robot.sample_limits().T
    return poses_at(rng.uniform(low, high, (count, cell.robot.dof)), **given)


def day(
    kr270: Cell, seed: int, count: int, markers: Array | None = None
) -> tuple[Cell, Measurements, np.random.Generator]:
    """A rigid arm anywhere; without ``markers`` nothing is guessed of three."""
    rng = np.random.default_rng(seed)
    cell = cell_of(kr270.robot, np.zeros((3, 3)) if markers is None else markers, RIGID)
    data, _ = measured(cell, random_configurations(cell, rng, count), rng)
    return cell, data, rng


@pytest.mark.parametrize("markers", [1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_instrument_anywhere_and_no_guess_of_the_markers(
    kr270: Cell, markers: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    cell = cell_of(kr270.robot, np.zeros((markers, 3)), RIGID)
    data, truth = measured(cell, random_configurations(cell, rng, 40), rng)
    result = calib.identify(cell, data)
    assert result.status == "converged"
    assert result.rms("fitted") < 2e-5 * np.sqrt(3)
    z = (result.values - truth) / result.std
    # The rotation vector of the base has a second form near pi: compare rotations there.
    turn = [i for i, p in enumerate(result.model.parameters) if p.effect == "base"][3:]
    np.testing.assert_allclose(
        so3_exp(result.values[turn]), so3_exp(truth[turn]), atol=6 * result.std[turn].max()
    )
    assert np.abs(np.delete(z, turn)).max() < 5.0


@pytest.mark.parametrize("seed", range(6))
def test_initial_values_are_exact_for_a_nominal_robot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 2 + seed, prismatic=(1,) if seed % 2 else ())
    cell = cell_of(robot, np.zeros((2, 3)), ("base", "tool"))
    data, _truth = measured(cell, random_configurations(cell, rng, 25), rng, noise=1e-12)
    model = build(cell, data.poses).model
    predicted = model.predict(initial_values(model, data), data.poses)
    np.testing.assert_allclose(predicted, data.points, atol=1e-9)


def test_known_base_or_known_markers(kr270: Cell) -> None:
    rng = np.random.default_rng(1)
    for effects in (("geometry",), ("base", "geometry"), ("tool", "geometry")):
        cell = cell_of(kr270.robot, MARKERS, effects)
        data, truth = measured(cell, random_configurations(cell, rng, 25), rng)
        result = calib.identify(cell, data)
        assert np.abs((result.values - truth) / result.std).max() < 4.5, effects


def test_two_step_reaches_the_minimum_of_the_joint_solver(kr270: Cell, table_two: Poses) -> None:
    data, _, _ = simulated(kr270, table_two, 1)
    joint = calib.identify(kr270, data)
    two_step = calib.identify(kr270, data, method="two-step")
    assert two_step.status == "converged"
    assert (np.abs(joint.values - two_step.values) / joint.std).max() < 1e-3
    assert two_step.rms("fitted") == pytest.approx(joint.rms("fitted"), rel=1e-9)
    assert two_step.iterations > joint.iterations


@pytest.mark.parametrize("weighting", ["full", "plain"])
def test_full_pose_approach_recovers_the_truth(
    kr270: Cell, table_two: Poses, weighting: str
) -> None:
    data, model, truth = simulated(kr270, table_two, 2)
    result = calib.identify(
        kr270,
        data,
        approach="pose",
        weighting=weighting,
        length=0.5,  # type: ignore[arg-type]
    )
    robot = [i for i, p in enumerate(model.parameters) if p.effect not in ("base", "tool")]
    assert (np.abs(result.values - truth)[robot] / result.std[robot]).max() < 4.5
    points = calib.identify(kr270, data)
    # Nothing beats the points; a plain weighting loses much.
    assert (result.std[robot] >= points.std[robot] * 0.999 * points.noise.factor).all()


def test_approach_pose_needs_markers_out_of_line(kr270: Cell) -> None:
    cell, data, _ = day(kr270, 0, 30, MARKERS[:2])
    with pytest.raises(CalibError, match="three visible markers"):
        calib.identify(cell, data, approach="pose")


@pytest.mark.long
def test_standard_deviations_when_points_err_together(kr270: Cell) -> None:
    """Every pose is off by a common vector: the levels of noise say so."""
    rng = np.random.default_rng(2)
    cell = cell_of(kr270.robot, MARKERS, ("base", "tool", "joint_offset:A2,A3,A4,A5"))
    poses = random_configurations(cell, rng, 80)
    model = build(cell, poses).model
    truth = np.zeros(len(model.parameters))
    by_levels = []
    for _ in range(60):
        data = drawn_readings(model, truth, poses, cell.noise, rng)
        common = rng.normal(size=(80, 1, 3)) * 1e-4
        found = calib.identify(cell, replace(data, readings=data.points + common))
        by_levels.append((found.values / found.std) ** 2)
    offsets = [i for i, p in enumerate(model.parameters) if p.effect == "joint_offset"]
    assert np.mean(by_levels, axis=0)[offsets].mean() == pytest.approx(1.0, abs=0.35)


def test_several_stations_share_markers_and_robot(kr270: Cell) -> None:
    rng = np.random.default_rng(3)
    cell = cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    station = np.arange(40) % 2
    poses = random_configurations(cell, rng, 40, station=station, stations=("north", "south"))
    data, _truth = measured(cell, poses, rng)
    result = calib.identify(cell, data)
    assert set(result.bases) == {"north", "south"}
    assert len(result.values) == 33 + 6
    assert result.rms("fitted") < 2e-5 * np.sqrt(3)


def test_hidden_markers_only_cost_information(kr270: Cell) -> None:
    cell, data, rng = day(kr270, 5, 40)
    seen = rng.random(data.seen.shape) > 0.3
    hidden = replace(data, seen=seen, readings=np.where(seen[..., None], data.points, 0.0))
    full, part = calib.identify(cell, data), calib.identify(cell, hidden)
    assert part.rms("fitted") < 2e-5 * np.sqrt(3)
    assert (part.std >= full.std * 0.999).all()


def test_outliers_are_listed_and_do_not_bend_the_result(kr270: Cell) -> None:
    cell, data, _ = day(kr270, 6, 60)
    bad = [7, 23, 41]
    points = data.points.copy()
    points[7] += np.array([0.0, 0.004, 0.0])
    points[23, 1] += np.array([0.001, 0.0, 0.0])
    points[41] = points[40]
    result = calib.identify(cell, replace(data, readings=points))
    assert list(np.flatnonzero(result.fit.outlier)) == bad
    assert result.noise.source == "cell"
    assert result.rms("fitted") < 2e-5 * np.sqrt(3) < result.rms("fitted_all")


@pytest.mark.parametrize("count", [15, 40, 120])
def test_clean_data_have_no_outliers(kr270: Cell, count: int) -> None:
    rng = np.random.default_rng(count)
    cell = cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    false = 0
    for _ in range(10):
        data, _ = measured(cell, random_configurations(cell, rng, count), rng)
        false += int(calib.identify(cell, data).fit.outlier.sum())
    assert false <= 1


def test_too_few_poses_says_how_many_are_needed(kr270: Cell) -> None:
    rng = np.random.default_rng(0)
    for markers, needed in ((1, 9), (2, 6), (3, 5)):
        cell = cell_of(kr270.robot, np.zeros((markers, 3)), RIGID)
        data, _ = measured(cell, random_configurations(cell, rng, needed), rng)
        assert calib.identify(cell, data).rank <= len(calib.parameters(cell))
        alone = replace(cell, size_prior="off")
        with pytest.raises(TooFewPoses, match=f"at least {needed} poses"):
            calib.identify(alone, data.take(slice(0, needed - 1)))


def test_sizes_hold_what_few_poses_leave_open(kr270: Cell) -> None:
    """With fewer equations than parameters every one is estimated, and what is open is named."""
    cell, data, _ = day(kr270, 0, 7, np.zeros((1, 3)))
    result = calib.identify(cell, data)
    assert result.status == "rank_deficient"
    assert result.rank <= 21 < len(result.values)
    assert (result.std > 0.0).all()
    with pytest.raises(TooFewPoses, match="at least 6 poses"):
        calib.identify(cell, data.take(slice(0, 5)))


def test_what_the_poses_do_not_show_is_named_and_left_nominal(kr270: Cell) -> None:
    """Joints that never move cannot tell their errors from those of their neighbours."""
    rng = np.random.default_rng(8)
    cell = cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    poses = random_configurations(cell, rng, 30)
    poses.q[:, 3:] = 0.3
    data, _ = measured(cell, poses, rng)
    result = calib.identify(cell, data)
    assert result.status == "rank_deficient"
    lost = {name for entry in result.unidentifiable for name in entry.names}
    assert result.rank == len(result.values) - len(lost)
    for p, value, std in zip(result.model.parameters, result.values, result.std, strict=True):
        if p.id in lost:
            assert (value == 0.0 and np.isnan(std)) or p.effect == "tool"
    assert result.rms("fitted") < 2e-5 * np.sqrt(3)


def test_compliance_under_a_vertical_load_says_nothing_of_the_first_joint(
    kr270: Cell, table_two: Poses
) -> None:
    cell = with_effects(kr270, "base", "tool", "joint_compliance")
    data, _, _ = simulated(with_effects(kr270, *kr270.effects), table_two, 0)
    result = calib.identify(cell, data)
    assert [u.names for u in result.unidentifiable] == [("joint_compliance:A1.compliance",)]


def test_noise_level_comes_from_where_the_evidence_is(kr270: Cell) -> None:
    rng = np.random.default_rng(9)
    cell = cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    poses = random_configurations(cell, rng, 30)
    repeated = poses.take(np.repeat(np.arange(30), 2))
    names = tuple(f"r{i}" for i in range(60))
    data, _ = measured(cell, replace(repeated, names=names), rng, noise=2e-5)
    level = calib.identify(cell, data).noise
    assert level.source == "replicates"
    assert level.sigma == pytest.approx(2e-5, rel=0.1)
    assert level.believed == pytest.approx(1e-5)
    single, _ = measured(cell, poses, rng, noise=2e-5)
    level = calib.identify(cell, single).noise
    assert level.source == "residual"
    assert level.sigma == pytest.approx(2e-5, rel=0.15)
    exact, _ = measured(cell, poses, rng, noise=1e-5)
    assert calib.identify(cell, exact).noise.source == "cell"


def test_split_keeps_configurations_whole(kr270: Cell, table_two: Poses) -> None:
    data, _, _ = simulated(kr270, table_two, 0)
    kept, held = data.split(0.2, np.random.default_rng(0))
    assert len(held) == 6
    stems = {name.rsplit("_", 1)[0] for name in held.poses.names}
    assert len(stems) == 3
    assert not stems & {name.rsplit("_", 1)[0] for name in kept.poses.names}


def test_a_robot_far_from_its_model_still_converges(kr270: Cell) -> None:
    """Ten millimetres and milliradians everywhere."""
    rng = np.random.default_rng(13)
    cell = cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    data, _ = measured(cell, random_configurations(cell, rng, 40), rng, size=10.0)
    result = calib.identify(cell, data)
    assert result.status == "converged"
    assert result.rms("fitted") < 2e-5 * np.sqrt(3)
