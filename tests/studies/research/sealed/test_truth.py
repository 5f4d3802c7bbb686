"""The truth against the model that it tests, effect by effect; bugs put into the model are noticed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco")

import calib
from calib.arm import statics
from calib.arm.se3 import rotate
from calib.cell import Cell, Repeatability
from calib.instruments.tracker import Tracker
from calib.noise import Noise
from studies.research.truth.arms import ARMS, HEAVY, RAIL, Arm
from studies.research.truth.causes import Cause
from studies.research.truth.day import Setting, draw_day, write_day
from studies.research.truth.effects import formula_of
from studies.research.truth.mechanism import frame_columns
from studies.research.truth.noise import growing
from studies.research.truth.scene import at_rest
from tests.studies.research.sealed.scenes import as_files, case_of, scene_of

ids = [arm.name for arm in ARMS]


@pytest.mark.parametrize("arm", ARMS, ids=ids)
def test_rigid_arm_is_the_urdf(arm: Arm, tmp_path: Path) -> None:
    scene = scene_of(arm)
    case = case_of(scene)
    cell, data = as_files(tmp_path / "case", case)
    still = scene.mechanism().posed(scene.session.q).points
    expected = calib.predict(cell, data, {})
    np.testing.assert_allclose(still[~scene.session.held], expected, atol=1e-9, rtol=0)


@pytest.mark.parametrize("arm", ARMS, ids=ids)
def test_elastic_arm_agrees(arm: Arm, tmp_path: Path) -> None:
    """Link weights, payload, hung load and compliances: two programs, one equilibrium."""
    scene = scene_of(arm)
    cell, data = as_files(tmp_path / "case", case := case_of(scene))
    values = {
        f"joint_compliance:{name}.compliance": scene.compliance[arm.names.index(name)]
        for name in scene.modelled
    }
    bent = calib.predict(cell, data, values)
    rigid = calib.predict(cell, data, {})
    assert np.abs(bent - rigid).max() > 1e-4, "the arm must bend for this to mean anything"
    np.testing.assert_allclose(case.clean[~scene.session.held], bent, atol=1e-7, rtol=0)


HOUR = 3600.0
# An effect, its place on the heavy arm, and its values; the model counts drifts by the second.
CAUSES: list[tuple[str, str, dict[str, float]]] = [
    ("joint_offset", "A3", {"offset": 1e-4}),
    ("link_geometry", "A3", {"x": 1e-5, "ry": 2e-5}),
    ("link_weight", "A3", {"mass": 1.0}),
    ("payload", "payload", {"mass": 1.0}),
    ("transmission_harmonic", "A3", {"cos_1": 1e-4, "sin_1": 2e-4, "cos_2": -1e-4, "sin_2": 3e-5}),
    ("transmission_scale", "A3", {"scale": 1e-4}),
    ("joint_coupling", "A3", {"from_A2": 1e-4}),
    ("backlash", "A3", {"half_width": 1e-4}),
    ("bearing_compliance", "A3", {"tilt": 1e-9}),
    ("base_compliance", "base", {"tilt": 1e-9}),
    ("base_drift", "base", {"x": 1e-5, "y": 2e-5, "rz": 1e-5}),
    ("thermal_expansion", "A3", {"growth": 1e-5}),
    ("tool_compliance", "tool", {"z": 1e-9, "rx": 1e-8}),
    ("tracker_scale", "instrument", {"scale": 1e-5}),
    ("tracker_drift", "instrument", {"x": 1e-5, "rz": 1e-5}),
    ("gravity_compensator", "A2", {"spring": 2e3, "preload": 1e2}),
    ("gear_ripple", "A3", {"cycles": 242.0, "cos_1": 4e-5, "sin_1": -6e-5}),
    ("warm_up", "A3", {"offset": 1e-4, "tau": 300.0}),
    ("step", "A3", {"offset": 1e-4, "at": 400.0}),
    ("friction_windup", "A3", {"torque": 30.0}),
    ("step", "base", {"x": 3e-5, "y": -1e-5, "rz": 2e-5, "at": 400.0}),
    ("step", "marker:m2", {"y": 4e-5, "at": 400.0}),
    ("warm_up", "instrument", {"x": 3e-5, "y": -1e-5, "rz": 2e-5, "tau": 300.0}),
]


@pytest.mark.parametrize(("effect", "where", "values"), CAUSES)
def test_an_effect_moves_the_readings_as_that_of_the_model_does(
    effect: str, where: str, values: dict[str, float], tmp_path: Path
) -> None:
    """Two programs that share no code: the same points, to the second order of the effect."""
    scene = scene_of(HEAVY)
    case, still = case_of(scene, Cause(effect, where, values)), case_of(scene)
    cell, data = as_files(tmp_path / "case", case)
    cell = replace(cell, effects=(*cell.effects, f"{effect}:{where}"))
    scale = 1.0 / HOUR if effect.endswith("_drift") else 1.0
    told = {f"{effect}:{where}.{name}": scale * value for name, value in values.items()}
    told |= {
        f"joint_compliance:{name}.compliance": scene.compliance[HEAVY.names.index(name)]
        for name in scene.modelled
    }
    fitted = ~scene.session.held
    moved = np.abs(case.clean - still.clean)[fitted].max()
    assert moved > 1e-6
    predicted = calib.predict(cell, data, told)
    np.testing.assert_allclose(case.clean[fitted], predicted, atol=2e-3 * moved, rtol=0)


def test_stiffness_and_sag() -> None:
    scene = scene_of(HEAVY)
    where, k = "A3", 2
    scene.knots[where] = np.radians([-85.0, 0.0, 125.0])
    state = at_rest(scene, scene.mechanism(), ())
    values = {"compliance@-85": 1e-8, "compliance@0": 0.0, "compliance@125": 3e-8}
    dq = formula_of("stiffness_vs_angle")(scene, state, where, values).joint[:, k]
    q = np.degrees(scene.session.q[:, k])
    share = np.where(q < 0, 1e-8 * q / -85.0, 3e-8 * q / 125.0)
    np.testing.assert_allclose(dq, share * state.torque[:, k], atol=1e-12)
    light = scene_of(HEAVY)
    weightless = replace(light, conditions=replace(light.conditions, weighs=False))
    sag = Cause("gravity_sag", "arm", {"weight": 1.0})
    np.testing.assert_allclose(case_of(weightless, sag).clean, case_of(light).clean, atol=1e-9)


def test_columns_are_derivatives() -> None:
    """Rigid motion beyond a frame against a displaced arm in MuJoCo."""
    scene = scene_of(RAIL)
    mechanism = scene.mechanism()
    state = mechanism.posed(scene.session.q)
    for frame in (0, 1, 4, RAIL.dof + 1):
        columns = frame_columns(state, frame)
        for c in range(6):
            geometry = np.zeros((RAIL.dof + 2, 6))
            geometry[frame, c] = 1e-6
            plus = type(mechanism)(RAIL, geometry, scene.markers).posed(scene.session.q).points
            minus = type(mechanism)(RAIL, -geometry, scene.markers).posed(scene.session.q).points
            np.testing.assert_allclose((plus - minus) / 2e-6, columns[..., c], atol=1e-6)


# -- Bugs put into physics and weights, one at a time: the independent truth must notice each


Put = Callable[[pytest.MonkeyPatch], None]
_SCATTER = 30e-6 / np.sqrt(3.0)  # m, of one coordinate of the tip


def loads_with(masses: float, gravity: float) -> Put:
    right = statics.loads_of

    def wrong(robot: Any, poses: Any, payload: Any, g: Any) -> Any:
        return right(replace(robot, masses=masses * robot.masses), poses, payload, gravity * g)

    return lambda patch: patch.setattr(statics, "loads_of", wrong)


def torque_too_large(patch: pytest.MonkeyPatch) -> None:
    right = statics.transmitted
    patch.setattr(
        statics, "transmitted", lambda *given: replace(own := right(*given), local=1.3 * own.local)
    )


def weights_times(factor: float) -> Put:
    right = Noise.whitening
    return lambda patch: patch.setattr(Noise, "whitening", lambda *own: factor * right(*own))


def sigma_read_threefold(patch: pytest.MonkeyPatch) -> None:
    right = Tracker.__init__

    def wrong(self: Tracker, sigma: float = 1.0, noise: Noise | None = None, **more: Any) -> None:
        right(self, 3.0 * sigma, noise and Noise.isotropic(3.0 * noise.along), **more)

    patch.setattr(Tracker, "__init__", wrong)


STATICS = {
    "torque x 1.3": torque_too_large,
    "gravity's sign": loads_with(masses=1.0, gravity=-1.0),
    "link masses x 3": loads_with(masses=3.0, gravity=1.0),
}
WEIGHTS = {
    "weights x 3": weights_times(3.0),
    "weights / 1.5": weights_times(1.0 / 1.5),
    "sigma read x 3": sigma_read_threefold,
}


@pytest.mark.parametrize("bug", ["", *STATICS])
def test_statics(bug: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Load, weights and compliances: two programs, one equilibrium, but for the bug."""
    scene = scene_of(HEAVY)
    cell, data = as_files(tmp_path / "case", case := case_of(scene))
    soft = [(name, scene.compliance[scene.index(name)]) for name in scene.modelled]
    values = {f"joint_compliance:{name}.compliance": value for name, value in soft}
    if bug:
        STATICS[bug](monkeypatch)
    off = np.abs(calib.predict(cell, data, values) - case.clean[~scene.session.held]).max()
    assert (off > 1e-5) if bug else (off < 1e-7)


def measured(
    folder: Path, scatter: float, seed: int
) -> tuple[Cell, calib.Measurements, calib.Measurements]:
    folder.mkdir()
    write_day(folder, draw_day(Setting("6R", scatter, 1, 60, 3), 1, seed))
    cell = calib.load_cell(folder / "cell.toml")
    read, exact = (
        calib.load_measurements(cell, folder / f"{n}.csv") for n in ("measurements", "exact")
    )
    return cell, read, exact


@pytest.mark.parametrize("bug", ["", *WEIGHTS])
def test_weights(bug: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The noise of the truth is what the cell says, but for the bug."""
    if bug:
        WEIGHTS[bug](monkeypatch)
    cell, data, _ = measured(tmp_path / "day", 0.0, 0)
    factor = calib.identify(cell, data).noise.factor
    assert (abs(np.log(factor)) > 0.3) if bug else (abs(np.log(factor)) < 0.1)


def test_weights_by_range_and_beam() -> None:
    """A tracker's noise grows with range and is smallest along the beam: two programs, one weight."""
    rng = np.random.default_rng(0)
    truth, place = growing(rng, 1e-5), rng.normal(size=6)
    points, off = rng.normal(size=(20, 1, 3)) * 2.0, rng.normal(size=(20, 1, 3)) * 1e-5
    stands = np.array([4.0, -1.0, 1.5])
    noise = Noise(truth.along, truth.across, across_per_m=truth.across_per_m)
    tracker, turn = Tracker(noise=noise, stands=stands), Rotation.from_rotvec(place[3:]).as_matrix()
    W = tracker.whitening(place, points @ turn.T + place[:3], np.full((20, 1), np.nan))
    white = truth.whitened(off, (points - stands) @ turn.T)
    np.testing.assert_allclose(rotate(W, off), white, rtol=1e-9)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_scatter_of_the_arm(times: float, tmp_path: Path) -> None:
    """What the cell says of the arm decides how far a result is off in its standard deviations."""
    off = []
    for seed in range(3):
        cell, data, exact = measured(tmp_path / str(seed), 30e-6, seed)
        said = Repeatability(times * _SCATTER, times * _SCATTER / 0.4)
        cell = replace(cell, repeatability=said)
        found, perfect = calib.identify(cell, data), calib.identify(cell, exact)
        free = (found.std > 0.0) & (perfect.std > 0.0)
        off.append(((found.values - perfect.values) / found.std)[free])
    rms = float(np.sqrt(np.mean(np.square(np.concatenate(off)))))
    assert (rms < 0.7) if times > 1.0 else (0.8 < rms < 1.2)
