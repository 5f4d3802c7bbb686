"""Every cause of the catalogue is found again in simulated data, beside a full model of the arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell, Identification, Measurements, Poses
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.effects import EFFECTS
from calib.errors import EffectCannotAct
from calib.model.build import build
from calib.noise import Noise
from calib.poses import hung, poses_at
from calib.poses.moves import with_moves
from calib.simulation import drawn_readings
from tests.helpers import cell_of, random_poses, random_robot, with_effects

ARM = ("base", "tool", "geometry", "joint_compliance:A2,A3,A4,A5,A6")
SOFT = np.array([0.28, 0.4, 2.8, 3.5, 2.1]) * 1e-6

FOUND = [
    "gravity_sag:A3",
    "gravity_compensator:A2",
    "link_weight:A3",
    "payload",
    "transmission_harmonic:A3",
    "transmission_scale:A4",
    "joint_coupling:A6",
    "backlash",
    "settling:A2",
    "friction_windup:A3",
    "bearing_compliance:A3",
    "base_compliance",
    "base_drift",
    "thermal_expansion:A2,A3",
    "tool_compliance",
    "tracker_drift",
]


def session(cell: Cell, rng: np.random.Generator, count: int = 60) -> Poses:
    """Free and loaded at each configuration, in random order of time, warming and cooling."""
    q = rng.uniform(*cell.robot.limits.T, (count, 6))
    time = np.sort(rng.uniform(0.0, 8 * 3600.0, 2 * count))
    poses = hung(
        poses_at(
            np.repeat(q, 2, axis=0),
            time=time + 1e5,
            temperature=22.0 + 4.0 * np.sin(time / 4000.0),
        ),
        1.0,
        (0.3, 0.0, 0.15),
    )
    poses = replace(poses, load_mass=np.tile([0.0, 250.0], count))
    return with_moves(poses.take(rng.permutation(2 * count)))


def simulated(
    cell: Cell, effect: str, poses: Poses, rng: np.random.Generator
) -> tuple[Cell, Measurements, Array]:
    """Data of an arm that is off in geometry, soft, and has one more cause of error."""
    cell = with_effects(cell, *ARM, effect)
    model = build(cell, poses).model
    truth = model.sizes * rng.normal(size=len(model.parameters)) * 0.3
    truth[model.where(EFFECTS["base"])] = [3.0, -1.0, 0.5, 0.2, -0.1, 2.0]
    soft = [p.effect == "joint_compliance" for p in model.parameters]
    truth[soft] = SOFT
    return cell, drawn_readings(model, truth, poses, Noise.isotropic(1e-5), rng), truth


def pulls(result: Identification, truth: Array, effect: str) -> Array:
    """Errors of an effect's parameters that were estimated, in standard deviations."""
    kind = effect.partition(":")[0]
    own = [p.effect == kind for p in result.model.parameters] & (result.std > 0.0)
    assert own.any()
    return (result.values - truth)[own] / result.std[own]


@pytest.mark.sampled
@pytest.mark.parametrize("effect", FOUND)
def test_recovered_beside_geometry_and_compliance(kr270: Cell, effect: str) -> None:
    rng = np.random.default_rng(5)
    kr270 = replace(kr270, load=None, payload=Payload(40.0, (0.1, 0.0, 0.1)))
    cell, data, truth = simulated(kr270, effect, session(kr270, rng), rng)
    result = calib.identify(cell, data)
    lost = {name for entry in result.unidentifiable for name in entry.names}
    # About the last joint's axis the tool yields as that joint's drive does.
    assert lost == ({"tool_compliance:tool.rx"} if effect == "tool_compliance" else set())
    assert np.abs(pulls(result, truth, effect)).max() < 4.0
    assert result.rms("fitted") == pytest.approx(np.sqrt(3) * 1e-5, rel=0.05)


def test_the_shared_catalogue_is_covered() -> None:
    elsewhere = {"base", "tool", "geometry", "joint_offset", "link_geometry"}
    elsewhere |= {"joint_compliance", "stiffness_vs_angle", "tracker_scale"}
    elsewhere |= {"gear_ripple", "warm_up", "step", "measured_torque"}  # test_identify_tunings
    # tests/calib/diagnosis/test_instruments.py and tests/properties/test_instruments.py
    elsewhere |= {"board_scale", "focal", "principal_point", "distortion"}
    assert {effect.partition(":")[0] for effect in FOUND} | elsewhere == set(EFFECTS)


@pytest.mark.parametrize(
    "effect",
    [
        "backlash",
        "transmission_scale:j2,j4",
        "joint_coupling:j2",
        "gravity_sag:j2",
        "gravity_sag:j3",
        "thermal_expansion",
        "tracker_scale",
    ],
)
def test_recovered_on_an_arm_with_a_slide_and_known_geometry(effect: str) -> None:
    rng = np.random.default_rng(11)
    robot = random_robot(rng, 5, (1,))
    cell = cell_of(robot, rng.uniform(-0.2, 0.2, (3, 3)), ("base", "tool", effect))
    poses = with_moves(random_poses(rng, robot, 60))
    model = build(cell, poses).model
    truth = model.sizes * rng.normal(size=len(model.parameters))
    data = drawn_readings(model, truth, poses, Noise.isotropic(1e-5), rng)
    result = calib.identify(cell, data)
    assert result.status == "converged"
    assert np.abs(pulls(result, truth, effect)).max() < 4.0


def test_scale_of_the_measured_wrench_beside_known_weights(kr270: Cell) -> None:
    """The links' own weight pins the compliances, so an error of the load cell stands out."""
    rng = np.random.default_rng(5)
    poses = session(kr270, rng)
    cell, data, truth = simulated(kr270, "payload:payload", poses, rng)
    result = calib.identify(cell, data)
    names = [p.name for p in result.model.parameters if p.effect == "payload"]
    assert names == ["scale", "com_x", "com_y", "com_z"]
    assert result.status == "converged"
    assert np.abs(pulls(result, truth, "payload")).max() < 4.0


def unidentifiable(cell: Cell, data: Measurements) -> dict[str, str]:
    found = calib.identify(cell, data)
    assert found.status == "rank_deficient"
    return {name: u.reason for u in found.unidentifiable for name in u.names}


def test_load_scale_and_compliance_are_one_product_without_other_weight(kr270: Cell) -> None:
    rng = np.random.default_rng(5)
    light = replace(kr270, robot=replace(kr270.robot, masses=np.zeros(6)))
    cell, data, _ = simulated(light, "payload", session(light, rng), rng)
    ((name, reason),) = unidentifiable(cell, data).items()
    assert name.startswith(("payload:payload.scale", "joint_compliance"))
    assert "moves the markers as" in reason


def test_both_drifts_move_everything_alike(kr270: Cell) -> None:
    """But a base that tilts also turns the arm's load: in a soft arm two of six directions differ."""
    rng = np.random.default_rng(5)
    cell, data, _ = simulated(kr270, "base_drift", session(kr270, rng), rng)
    both = ("base_drift", "tracker_drift")
    for arm, count in ((ARM[:3], 6), (ARM, 4)):
        lost = unidentifiable(with_effects(cell, *arm, *both), data)
        assert len(lost) == count
        assert all("drift" in name and "drift" in reason for name, reason in lost.items())


def test_a_steady_temperature_cannot_be_told_from_geometry(kr270: Cell) -> None:
    rng = np.random.default_rng(5)
    poses = replace(session(kr270, rng), temperature=np.full(120, 25.0))
    cell, data, _ = simulated(kr270, "thermal_expansion:arm", poses, rng)
    assert any("growth" in name for name in unidentifiable(cell, data))
    at_home = replace(data, poses=replace(poses, temperature=np.full(120, 20.0)))
    with pytest.raises(
        EffectCannotAct, match=r"thermal_expansion:arm .* measure where temperature differs"
    ):
        calib.identify(cell, at_home)


@pytest.mark.parametrize(
    ("effect", "changed", "message"),
    [
        ("backlash:A5", "approach", r"backlash:A5 cannot act: .* measure where approach differs"),
        ("base_drift", "time", r"base_drift:base cannot act: .* measure where time differs"),
        ("tracker_drift", "time", r"tracker_drift:instrument .* measure where time differs"),
    ],
)
def test_idle_effects_are_refused(kr270: Cell, effect: str, changed: str, message: str) -> None:
    rng = np.random.default_rng(5)
    cell, data, _ = simulated(kr270, effect, session(kr270, rng), rng)
    same = np.zeros_like(getattr(data.poses, changed))
    poses = replace(data.poses, start=0.0, **{changed: same})
    with pytest.raises(EffectCannotAct, match=message):
        calib.identify(cell, replace(data, poses=poses))


def test_backlash_of_the_published_example(data: Path) -> None:
    """Truth from another simulator: 120 urad at a5, held-out poses in a file of their own."""
    folder = data / "examples" / "one_effect"
    cell = calib.load_cell(folder / "cell.toml")
    fitted = calib.load_measurements(cell, folder / "measurements.csv")
    held = calib.load_measurements(cell, folder / "heldout.csv", every_marker=False)
    fitted, held = calib.in_one_session(fitted, held)
    before = calib.identify(cell, fitted, heldout=held)
    result = calib.identify(with_effects(cell, *cell.effects, "backlash:a5"), fitted, heldout=held)
    assert abs(result.values[-1] - 120e-6) < 3.0 * result.std[-1]
    assert result.std[-1] < 3e-6
    assert (before.rms("heldout") or 0.0) > 6e-5
    assert (result.rms("heldout") or 1.0) < 2.9e-5
