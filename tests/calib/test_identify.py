"""Identification on simulated data: from nothing, by any road, with what real tables contain."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Identification, Measurements, Poses
from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.errors import CalibError, TooFewPoses
from calib.identification.start import initial_values
from calib.model.build import build
from tests.day import ON_TOOL, RIGID, anywhere, erring, rigid_day
from tests.helpers import cell_of, random_robot, simulated, with_effects
from tests.touched_arm import parallel

NOISE = np.sqrt(3) * 1e-5  # m, 3-D RMS of readings


def off(found: Identification, truth: np.ndarray) -> np.ndarray:
    """Errors in standard deviations."""
    return np.abs(found.values - truth) / found.std


# -- From nothing, by any road


def assert_at_the_noise(found: Identification) -> None:
    assert found.status == "converged"
    assert found.rms("fitted") < 2.0 * NOISE


@pytest.mark.parametrize(
    ("seed", "markers", "size"),
    [*((seed, markers, 1.0) for seed in range(4) for markers in (1, 2, 3)), (13, 3, 10.0)],
)
def test_instrument_anywhere_and_no_guess_of_the_markers(
    kr270: Cell, seed: int, markers: int, size: float
) -> None:
    """Errors in their sizes, of a millimetre and a milliradian, or ten times as large."""
    cell, data, truth, _ = rigid_day(kr270.robot, seed, 40 if size == 1.0 else 25, markers, size)
    result = calib.identify(cell, data)
    assert_at_the_noise(result)
    # The rotation vector of the base has a second form near pi: compare rotations there.
    turn = [i for i, p in enumerate(result.model.parameters) if p.effect == "base"][3:]
    np.testing.assert_allclose(
        so3_exp(result.values[turn]), so3_exp(truth[turn]), atol=6 * result.std[turn].max()
    )
    assert np.delete(off(result, truth), turn).max() < 5.0


@pytest.mark.parametrize("seed", range(6))
def test_initial_values_are_exact_for_a_nominal_robot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 2 + seed, prismatic=(1,) if seed % 2 else ())
    cell = cell_of(robot, np.zeros((2, 3)), ("base", "tool"))
    data, _ = erring(cell, anywhere(cell, rng, 25), rng, noise=1e-12)
    model = build(cell, data.poses).model
    predicted = model.predict(initial_values(model, data), data.poses)
    np.testing.assert_allclose(predicted, data.points, atol=1e-9)


@pytest.mark.parametrize("effects", [("geometry",), ("base", "geometry"), ("tool", "geometry")])
def test_known_base_or_known_markers(kr270: Cell, effects: tuple[str, ...]) -> None:
    rng = np.random.default_rng(1)
    cell = cell_of(kr270.robot, ON_TOOL, effects)
    data, truth = erring(cell, anywhere(cell, rng, 25), rng)
    assert off(calib.identify(cell, data), truth).max() < 4.5


Day = tuple[Measurements, Array, Identification]


@pytest.fixture(scope="module")
def paper_day(kr270: Cell, table_two: Poses) -> Day:
    """The paper's readings, the truth, and what the points tell of it."""
    data, _, truth = simulated(kr270, table_two, 2)
    return data, truth, calib.identify(kr270, data)


def test_two_step_reaches_the_minimum_of_the_joint_solver(kr270: Cell, paper_day: Day) -> None:
    data, _, joint = paper_day
    two_step = calib.identify(kr270, data, method="two-step")
    assert two_step.status == "converged"
    assert (np.abs(joint.values - two_step.values) / joint.std).max() < 1e-3
    assert two_step.rms("fitted") == pytest.approx(joint.rms("fitted"), rel=1e-9)
    assert two_step.iterations > joint.iterations


@pytest.mark.parametrize("weighting", ["full", "plain"])
def test_full_pose_approach_recovers_the_truth(kr270: Cell, paper_day: Day, weighting: str) -> None:
    data, truth, points = paper_day
    result = calib.identify(kr270, data, approach="pose", weighting=weighting, length=0.5)  # type: ignore[arg-type]
    own = result.model.parameters
    robot = [i for i, p in enumerate(own) if p.effect not in ("base", "tool")]
    assert off(result, truth)[robot].max() < 4.5
    # Nothing beats the points; a plain weighting loses much.
    assert (result.std[robot] >= points.std[robot] * 0.999 * points.noise.factor).all()


ARMS = {"scara": (4, (3,), True), "planar": (2, (), True), "one joint": (1, (), False)}


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("approach", ["points", pytest.param("pose", marks=pytest.mark.long)])
def test_arms_whose_base_and_markers_hide_each_other(arm: str, approach: str) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        dof, prismatic, flat = ARMS[arm]
        robot = random_robot(rng, dof, prismatic)
        robot = parallel(robot) if flat else robot
        cell = cell_of(robot, ON_TOOL, RIGID)
        data, _ = erring(cell, anywhere(cell, rng, 30), rng, 0.3)
        assert_at_the_noise(calib.identify(cell, data, approach=approach))  # type: ignore[arg-type]


# -- What tables contain


def test_several_stations_share_markers_and_robot(kr270: Cell) -> None:
    rng, cell = np.random.default_rng(3), cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    given = {"station": np.arange(40) % 2, "stations": ("north", "south")}
    data, _ = erring(cell, anywhere(cell, rng, 40, **given), rng)
    result = calib.identify(cell, data)
    assert set(result.bases) == {"north", "south"}
    assert len(result.values) == 33 + 6
    assert result.rms("fitted") < 2.0 * NOISE


def test_hidden_markers_only_cost_information(kr270: Cell) -> None:
    cell, data, _, rng = rigid_day(kr270.robot, 5, 40)
    seen = rng.random(data.seen.shape) > 0.3
    hidden = replace(data, seen=seen, readings=np.where(seen[..., None], data.points, 0.0))
    full, part = calib.identify(cell, data), calib.identify(cell, hidden)
    assert part.rms("fitted") < 2.0 * NOISE
    assert (part.std >= full.std * 0.999).all()


def test_full_pose_with_hidden_markers_is_not_biased(kr270: Cell) -> None:
    rng = np.random.default_rng(0)
    cell = cell_of(kr270.robot, np.zeros((4, 3)), RIGID)
    true = replace(cell, markers=np.vstack([ON_TOOL, [[0.3, 0.05, 0.1]]]))
    data, _ = erring(true, anywhere(cell, rng, 40), rng)
    seen = np.ones(data.seen.shape, dtype=bool)
    seen[np.arange(40), rng.integers(0, 4, 40)] = False
    hidden = replace(data, seen=seen, readings=data.points * seen[..., None])
    result = calib.identify(cell, hidden, approach="pose")
    assert result.noise.source == "cell"
    assert result.rms("fitted") < 2.0 * NOISE


def test_poses_without_orientation_are_named(kr270: Cell) -> None:
    cell, data, _, _ = rigid_day(kr270.robot, 1, 40, ON_TOOL)
    seen = data.seen.copy()
    seen[[3, 8], 0] = False
    result = calib.identify(cell, replace(data, seen=seen), approach="pose")
    assert result.unused == (data.poses.names[3], data.poses.names[8])
    assert result.dof == 3 * int(seen.sum() - 4) - result.rank
    two = replace(cell, markers=ON_TOOL[:2], marker_names=("m1", "m2"))
    alone = replace(
        data, seen=data.seen[:, :2], readings=data.points[:, :2], sigma=data.sigma[:, :2]
    )
    with pytest.raises(CalibError, match="three visible markers"):
        calib.identify(two, alone, approach="pose")


def test_held_out_points_keep_their_own_deviation(kr270: Cell) -> None:
    cell, data, _, rng = rigid_day(kr270.robot, 5, 40, ON_TOOL)
    points = data.points[:20] + rng.normal(size=(20, 3, 3)) * 2e-4
    held = replace(data.take(slice(0, 20)), readings=points, sigma=np.full((20, 3), 2e-4))
    result = calib.identify(cell, data.take(slice(20, None)), heldout=held)
    assert not result.heldout.outlier.any()


def test_split_keeps_configurations_whole(kr270: Cell, table_two: Poses) -> None:
    data, _, _ = simulated(kr270, table_two, 0)
    kept, held = data.split(0.2, np.random.default_rng(0))
    assert len(held) == 6
    stems = [{name.rsplit("_", 1)[0] for name in own.poses.names} for own in (held, kept)]
    assert len(stems[0]) == 3
    assert not stems[0] & stems[1]


def test_noise_level_comes_from_where_the_evidence_is(kr270: Cell) -> None:
    rng, cell = np.random.default_rng(9), cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    poses = anywhere(cell, rng, 30)
    twice = replace(
        poses.take(np.repeat(np.arange(30), 2)), names=tuple(f"r{i}" for i in range(60))
    )
    for own, noise, source, rel in (
        (twice, 2e-5, "replicates", 0.1), (poses, 2e-5, "residual", 0.15), (poses, 1e-5, "cell", 1.0)
    ):  # fmt: skip
        level = calib.identify(cell, erring(cell, own, rng, noise=noise)[0]).noise
        assert level.source == source
        assert level.sigma == pytest.approx(noise, rel=rel)
        assert level.believed == pytest.approx(1e-5)


# -- What poses do not tell


@pytest.mark.parametrize(("markers", "needed"), [(1, 9), (2, 6), (3, 5)])
def test_too_few_poses_says_how_many_are_needed(kr270: Cell, markers: int, needed: int) -> None:
    cell, data, _, _ = rigid_day(kr270.robot, 0, needed, markers)
    assert calib.identify(cell, data).rank <= len(calib.parameters(cell))
    with pytest.raises(TooFewPoses, match=f"at least {needed} poses"):
        calib.identify(replace(cell, size_prior="off"), data.take(slice(0, needed - 1)))


def test_sizes_hold_what_few_poses_leave_open(kr270: Cell) -> None:
    """With fewer equations than parameters every one is estimated, and what is open is named."""
    cell, data, _, _ = rigid_day(kr270.robot, 0, 7, 1)
    result = calib.identify(cell, data)
    assert result.status == "rank_deficient"
    assert result.rank <= 21 < len(result.values)
    assert (result.std > 0.0).all()
    with pytest.raises(TooFewPoses, match="at least 6 poses"):
        calib.identify(cell, data.take(slice(0, 5)))


def test_what_the_poses_do_not_show_is_named_and_left_nominal(kr270: Cell) -> None:
    """Joints that never move cannot tell their errors from those of their neighbours."""
    rng, cell = np.random.default_rng(8), cell_of(kr270.robot, np.zeros((3, 3)), RIGID)
    poses = anywhere(cell, rng, 30)
    poses.q[:, 3:] = 0.3
    result = calib.identify(cell, erring(cell, poses, rng)[0])
    assert result.status == "rank_deficient"
    lost = {name for entry in result.unidentifiable for name in entry.names}
    assert result.rank == len(result.values) - len(lost)
    for p, value, std in zip(result.model.parameters, result.values, result.std, strict=True):
        if p.id in lost:
            assert (value == 0.0 and np.isnan(std)) or p.effect == "tool"
    assert result.rms("fitted") < 2.0 * NOISE


def test_compliance_under_a_vertical_load_says_nothing_of_the_first_joint(
    kr270: Cell, table_two: Poses
) -> None:
    data, _, _ = simulated(kr270, table_two, 0)
    result = calib.identify(with_effects(kr270, "base", "tool", "joint_compliance"), data)
    assert [u.names for u in result.unidentifiable] == [("joint_compliance:A1.compliance",)]


def test_an_arm_too_soft_to_stand_is_refused(kr270: Cell) -> None:
    cell = with_effects(kr270, "joint_compliance:A2")
    with pytest.raises(CalibError, match="finds no equilibrium"):
        calib.predict(cell, np.zeros((1, 6)), {"joint_compliance:A2.compliance": 1e-3})


@pytest.mark.long
def test_nonsense_units_are_not_called_a_success(kr270: Cell) -> None:
    cell, data, _, _ = rigid_day(kr270.robot, 3, 15, ON_TOOL)
    with pytest.raises(CalibError, match="check the units"):
        calib.identify(cell, replace(data, readings=data.points * 2e3))
    result = calib.identify(cell, replace(data, readings=data.points * 9.0))
    assert any("check units" in text for text in result.warnings)


# -- Real measurements, and errors that published fits reach, in mm and, of whole poses, mrad

NOMINAL_AND_FITTED = {
    "irb120_faro": ([0.839], "fitted", [0.200]),
    "irb120_wu2015": ([5.330], "fitted", [0.247]),
    "fanuc_r2000": ([0.747], "fitted", [0.340]),
    "ur10_leica_b": ([1.104], "fitted", [0.460]),
    "fr3_eye_in_hand": ([4.54, 12.1], "fitted_all", [1.6, 4.2]),
    "positioner_poses": ([0.458, 0.98], "fitted_all", [0.44, 1.0]),
    "panda_sockets_2": ([8.44], "fitted_all", [0.306]),  # a ball in 16 sockets
}
OPEN = {"panda_sockets_2"}  # something is left that contacts do not tell
HELD_OUT = {  # the median of so many shares of three in ten
    "irb120_faro": (5, [0.32]),
    "fr3_eye_in_hand": (5, [1.6, 4.2]),
    "positioner_poses": (10, [0.44, 1.0]),
    "iiwa7_torque": (5, [0.70, 4.0]),
    "panda_sockets_2": (2, [0.40]),
}


def real(data: Path, name: str) -> tuple[Cell, calib.Measurements]:
    cell = calib.load_cell(data / name / "cell.toml")
    return cell, calib.load_measurements(cell, data / name / "measurements.csv")


@cache
def result(data: Path, name: str) -> Identification:
    return calib.identify(*real(data, name))


def errors(found: Identification, of: str) -> list[float]:
    """mm of all that was read, and mrad."""
    turned = (own[of] for (_, unit), own in found.by_instrument.items() if unit == "mrad")
    return [1e3 * found.rms(of), *turned]


@pytest.mark.long
@pytest.mark.parametrize("name", NOMINAL_AND_FITTED)
def test_real_days_before_and_after(data: Path, name: str) -> None:
    found, (nominal, of, fitted) = result(data, name), NOMINAL_AND_FITTED[name]
    assert found.status == ("rank_deficient" if name in OPEN else "converged")
    assert found.noise.source == "residual"
    np.testing.assert_allclose(errors(found, "nominal"), nominal, rtol=0.01)
    assert (np.array(errors(found, of)) <= 1.01 * np.array(fitted)).all()


@pytest.mark.long
@pytest.mark.parametrize("name", HELD_OUT)
def test_held_out_poses_of_real_days(data: Path, name: str) -> None:
    (cell, table), (shares, most), trimmed = real(data, name), HELD_OUT[name], []
    found = []
    for seed in range(shares):
        kept, held = table.split(0.3, np.random.default_rng(seed))
        one = calib.identify(cell, kept, heldout=held)
        assert one.status == "converged" or name in OPEN
        found.append(errors(one, "heldout"))
        trimmed.append(1e3 * one.rms("heldout_trimmed"))
    assert (np.median(found, axis=0) <= most).all()
    if name == "irb120_faro":
        assert max(trimmed) <= 0.21


def test_outliers_of_the_faro_set(data: Path) -> None:
    found = result(data, "irb120_faro")
    assert found.fit.outlier.sum() <= 15
    assert found.rms("fitted_all") * 1e3 <= 0.272 * 1.01


def test_simulated_case_without_effect(data: Path) -> None:
    """Compliances of the truth, written by another program; a1 is not observable."""
    found = result(data, "examples/no_effect")
    ratio = np.sqrt(np.sum(found.fit.vectors**2) / found.dof) / 1.2e-5
    assert 0.95 < ratio < 1.05
    assert found.noise.source == "cell"
    truth = {"a2": 9.0, "a3": 12.0, "a4": 40.0, "a5": 45.0, "a6": 50.0}
    for p, value, std in zip(found.model.parameters, found.values, found.std, strict=True):
        if p.effect == "joint_compliance":
            assert abs(value / p.scale - truth[p.where]) < 3.0 * std / p.scale, p.id


@pytest.mark.long
def test_lost_motion_of_the_published_example(data: Path) -> None:
    """Truth from another simulator: 120 urad at a5, held-out poses in a file of their own."""
    cell, fitted = real(data, "examples/one_effect")
    path = data / "examples" / "one_effect" / "heldout.csv"
    held = calib.load_measurements(cell, path, every_marker=False)
    fitted, held = calib.in_one_session(fitted, held)
    before = calib.identify(cell, fitted, heldout=held)
    found = calib.identify(with_effects(cell, *cell.effects, "backlash:a5"), fitted, heldout=held)
    assert abs(found.values[-1] - 120e-6) < 3.0 * found.std[-1]
    assert found.std[-1] < 3e-6
    assert (before.rms("heldout") or 0.0) > 6e-5
    assert (found.rms("heldout") or 1.0) < 2.9e-5
