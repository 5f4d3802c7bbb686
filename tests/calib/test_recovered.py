"""Every cause of the catalogue is found again in simulated data, with intervals that hold."""

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
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.effects import EFFECTS
from calib.effects.tuned import Tuned
from calib.errors import CalibError, EffectCannotAct
from calib.files.estimate import load_estimate
from calib.identification.scan import carried, falls, times
from calib.inference.evidence import score_test
from calib.model.build import build, context_of, place_effect
from calib.noise import Noise
from calib.observations.scatter import Variances
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from calib.prediction.estimate import estimate_of
from calib.simulation import drawn_readings
from studies.results.estimate import Estimated
from tests.day import day, free_and_loaded
from tests.helpers import all_seen, cell_of, random_poses, random_robot, stage_of, with_effects
from tests.plain_arm import tips

ARM = ("base", "tool", "geometry", "joint_compliance:A2,A3,A4,A5,A6")
FOUND = (
    "gravity_sag:A3", "gravity_compensator:A2", "link_weight:A3", "payload",
    "transmission_harmonic:A3", "transmission_scale:A4", "joint_coupling:A6", "backlash",
    "settling:A2", "friction_windup:A3", "bearing_compliance:A3", "base_compliance", "base_drift",
    "thermal_expansion:A2,A3", "tool_compliance", "tracker_drift",
)  # fmt: skip
ON_A_SLIDE = (
    "backlash", "transmission_scale:j2,j4", "joint_coupling:j2", "gravity_sag:j2", "gravity_sag:j3",
    "thermal_expansion", "tracker_scale",
)  # fmt: skip


def soft_day(cell: Cell, effect: str, **given: Array) -> tuple[Cell, Measurements, Array]:
    """Data of an arm that is off in geometry, soft, and has one more cause of error."""
    rng = np.random.default_rng(5)
    poses = with_moves(replace(free_and_loaded(rng, cell, 60), **given))
    cell = with_effects(cell, *ARM, effect)
    model = build(cell, poses).model
    truth = model.sizes * rng.normal(size=len(model.parameters)) * 0.3
    truth[model.where(EFFECTS["base"])] = [3.0, -1.0, 0.5, 0.2, -0.1, 2.0]
    soft = [p.effect == "joint_compliance" for p in model.parameters]
    truth[soft] = np.array([0.28, 0.4, 2.8, 3.5, 2.1]) * 1e-6
    return cell, drawn_readings(model, truth, poses, Noise.isotropic(1e-5), rng), truth


def pulls(result: Identification, truth: Array, effect: str) -> Array:
    """Errors of an effect's parameters that were estimated, in standard deviations."""
    kind = effect.partition(":")[0]
    own = [p.effect == kind for p in result.model.parameters] & (result.std > 0.0)
    assert own.any()
    return np.abs(result.values - truth)[own] / result.std[own]


def lost(result: Identification) -> dict[str, str]:
    """What was not identified, with the reason."""
    return {name: u.reason for u in result.unidentifiable for name in u.names}


@pytest.mark.sampled
@pytest.mark.parametrize("effect", FOUND)
def test_recovered_beside_geometry_and_compliance(kr270: Cell, effect: str) -> None:
    arm = replace(kr270, load=None, payload=Payload(40.0, (0.1, 0.0, 0.1)))
    cell, data, truth = soft_day(arm, effect)
    result = calib.identify(cell, data)
    # About the last joint's axis the tool yields as that joint's drive does.
    alike = {"tool_compliance:tool.rx"} if effect == "tool_compliance" else set()
    assert lost(result).keys() == alike
    assert pulls(result, truth, effect).max() < 4.0
    assert result.rms("fitted") == pytest.approx(np.sqrt(3) * 1e-5, rel=0.05)


def test_the_shared_catalogue_is_covered() -> None:
    elsewhere = {"base", "tool", "geometry", "joint_offset", "link_geometry", "joint_compliance"}
    elsewhere |= {"stiffness_vs_angle", "tracker_scale", "measured_torque"}
    elsewhere |= {name.partition(":")[0] for name in SCENES}
    # tests/calib/test_faults.py and tests/properties/test_instruments.py
    elsewhere |= {"board_scale", "focal", "principal_point", "distortion"}
    assert {effect.partition(":")[0] for effect in FOUND} | elsewhere == set(EFFECTS)


@pytest.mark.parametrize("effect", ON_A_SLIDE)
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
    assert pulls(result, truth, effect).max() < 4.0


# -- What readings cannot tell apart


def test_scale_of_the_measured_wrench_needs_another_weight(kr270: Cell) -> None:
    """The links' own weight pins the compliances; without it load and compliance are one product."""
    light = replace(kr270, robot=replace(kr270.robot, masses=np.zeros(6)))
    result = calib.identify(*soft_day(light, "payload")[:2])
    ((name, reason),) = lost(result).items()
    assert result.status == "rank_deficient"
    assert name.startswith(("payload:payload.scale", "joint_compliance"))
    assert "moves the markers as" in reason


def test_both_drifts_move_everything_alike(kr270: Cell) -> None:
    """But a base that tilts also turns the arm's load: in a soft arm two of six directions differ."""
    cell, data, _ = soft_day(kr270, "base_drift")
    for arm, count in ((ARM[:3], 6), (ARM, 4)):
        both = with_effects(cell, *arm, "base_drift", "tracker_drift")
        gone = lost(calib.identify(both, data))
        assert len(gone) == count
        assert all("drift" in name and "drift" in reason for name, reason in gone.items())


def test_a_steady_temperature_cannot_be_told_from_geometry(kr270: Cell) -> None:
    cell, data, _ = soft_day(kr270, "thermal_expansion:arm", temperature=np.full(120, 25.0))
    assert any("growth" in name for name in lost(calib.identify(cell, data)))
    at_home = replace(data, poses=with_moves(replace(data.poses, temperature=np.full(120, 20.0))))
    said = r"thermal_expansion:arm .* measure where temperature differs"
    with pytest.raises(EffectCannotAct, match=said):
        calib.identify(cell, at_home)


@pytest.mark.parametrize(
    ("effect", "changed", "said"),
    [
        ("backlash:A5", "approach", r"backlash:A5 cannot act: .* measure where approach differs"),
        ("base_drift", "time", r"base_drift:base cannot act: .* measure where time differs"),
        ("tracker_drift", "time", r"tracker_drift:instrument .* measure where time differs"),
    ],
)
def test_idle_effects_are_refused(kr270: Cell, effect: str, changed: str, said: str) -> None:
    cell, data, _ = soft_day(kr270, effect)
    same = np.zeros_like(getattr(data.poses, changed))
    poses = replace(data.poses, start=0.0, **{changed: same})
    with pytest.raises(EffectCannotAct, match=said):
        calib.identify(cell, replace(data, poses=poses))


# -- Tunings, in data of plain numpy

SIGMA = 1e-5
MARKERS = np.array([[0.1, 0.0, 0.2], [-0.1, 0.1, 0.1], [0.0, -0.1, 0.15]])
R, P = so3_exp(np.array([0.3, -0.2, 0.5])), np.array([2.0, 1.0, 0.5])


def arm(*effects: str) -> Cell:
    robot = random_robot(np.random.default_rng(1), 4)
    return cell_of(robot, MARKERS, ("base", "tool", *effects), SIGMA)


def session(cell: Cell, rng: np.random.Generator, count: int, timed: bool = False) -> Poses:
    q = rng.uniform(*cell.robot.limits.T, (count, cell.robot.dof))
    given = {"time": 5e4 + np.cumsum(rng.uniform(20.0, 40.0, count))} if timed else {}
    return with_moves(poses_at(q, **given))


def read(
    cell: Cell, poses: Poses, rng: np.random.Generator, dq: Array | float = 0.0,
    shift: Array | float = 0.0,
) -> Measurements:  # fmt: skip
    """Readings of an arm whose joints are off by dq (m, n) and whose readings by shift (m, 3)."""
    T = tips(cell.robot, poses.q + dq)
    points = MARKERS @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    points = points @ R.T + P + np.broadcast_to(shift, (len(poses), 3))[:, None]
    return all_seen(poses, points + rng.normal(scale=SIGMA, size=points.shape))


def off_at(poses: Poses, joint: int, by: Array) -> Array:
    """Errors (m, n) of one joint."""
    return by[:, None] * (np.arange(poses.q.shape[1]) == joint)


def ripple(cell: Cell, rng: np.random.Generator) -> tuple[Measurements, float]:
    poses, cycles = session(cell, rng, 50), rng.uniform(20.0, 400.0)
    wave = 6e-5 * np.cos(cycles * poses.q[:, 1] + rng.uniform(0.0, 6.0))
    return read(cell, poses, rng, off_at(poses, 1, wave)), cycles


def warming(cell: Cell, rng: np.random.Generator) -> tuple[Measurements, float]:
    poses, tau = session(cell, rng, 50, timed=True), rng.uniform(200.0, 900.0)
    left = np.exp(-(poses.time - poses.time[0]) / tau)
    return read(cell, poses, rng, shift=left[:, None] * [5e-5, -8e-5, 3e-5]), tau


def jump(cell: Cell, rng: np.random.Generator) -> tuple[Measurements, float]:
    poses, moment = session(cell, rng, 50), rng.uniform(5.0, 44.0)
    return read(cell, poses, rng, off_at(poses, 2, 3e-5 * (np.arange(50) > moment))), moment


SCENES: dict[str, Callable[[Cell, np.random.Generator], tuple[Measurements, float]]] = {
    "gear_ripple:j2": ripple,
    "warm_up:instrument": warming,
    "step:j3": jump,
}


def tuning(result: Identification | calib.Estimate) -> tuple[float, float]:
    """Value and standard deviation of the one tuning."""
    (at,) = result.model.tunings
    return float(result.values[at]), float(np.sqrt(np.diag(result.covariance)[at]))


@pytest.mark.long
@pytest.mark.parametrize("effect", ["gear_ripple:j2", "warm_up:instrument"])
def test_intervals_hold(effect: str) -> None:
    """Of 12 trials no more than three may lie outside, at 95 per cent in one case of 450."""
    cell, errors = arm(effect), []
    for seed in range(12):
        data, truth = SCENES[effect](cell, np.random.default_rng(seed))
        result = calib.identify(cell, data)
        assert result.status == "converged"
        value, std = tuning(result)
        errors.append(abs(value - truth) / std)
    assert np.sum(np.array(errors) > 1.96) <= 3
    assert np.median(errors) < 1.2


@pytest.mark.long
def test_ripples_of_three_joints_are_found_at_once_beside_geometry() -> None:
    cell, rng = arm("geometry", "gear_ripple:j1,j2,j3"), np.random.default_rng(3)
    poses, cycles = session(cell, rng, 90), np.array([201.3, 96.7, 320.2])
    dq = np.zeros_like(poses.q)
    dq[:, :3] = 5e-5 * np.cos(cycles * poses.q[:, :3] + [0.5, 1.0, 2.0])
    result = calib.identify(cell, read(cell, poses, rng, dq))
    at = result.model.tunings
    assert (np.abs(result.values[at] - cycles) < 4.0 * result.std[at]).all()
    assert (result.std[at] < 0.1).all()
    assert result.rms("fitted") == pytest.approx(np.sqrt(3.0) * SIGMA, rel=0.15)


def test_a_known_gear_ratio_leaves_two_lines_to_try() -> None:
    cell, rng = replace(arm("gear_ripple:j2"), gear_ratios={"j2": 80.6}), np.random.default_rng(4)
    poses = session(cell, rng, 30)
    dq = off_at(poses, 1, 2.2e-5 * np.sin(161.2 * poses.q[:, 1]))
    known = calib.identify(cell, read(cell, poses, rng, dq))
    value, std = tuning(known)
    assert value == pytest.approx(161.2, abs=4.0 * std)
    np.testing.assert_allclose(known.model.effects[-1].grid(poses), [80.6, 161.2])  # type: ignore[attr-defined]


def test_an_outlier_is_no_step() -> None:
    cell, rng = arm("step:j3"), np.random.default_rng(6)
    poses = session(cell, rng, 50)
    data = read(cell, poses, rng, off_at(poses, 2, 3e-5 * (np.arange(50) > 24.5)))
    data.readings[47] += 0.02
    result = calib.identify(cell, data)
    assert abs(tuning(result)[0] - 24.5) <= 2.0
    assert list(np.flatnonzero(result.fit.outlier)) == [47]


def test_held_out_poses_need_the_clock() -> None:
    cell, rng = arm("step:j3"), np.random.default_rng(7)
    data, other = jump(cell, rng)[0], jump(cell, rng)[0]
    kept, held = data.split(0.2, np.random.default_rng(0))
    shared = calib.identify(cell, kept, heldout=held)
    assert shared.rms("heldout") == pytest.approx(np.sqrt(3.0) * SIGMA, rel=0.3)
    with pytest.raises(CalibError, match=r"held-out poses have no time, which step:j3 needs"):
        calib.identify(cell, data, heldout=other)


def test_nothing_to_scan_is_refused() -> None:
    cell, rng = arm("gear_ripple:j2"), np.random.default_rng(8)
    poses = session(cell, rng, 30)
    still = replace(poses, q=np.where([True, False, True, True], poses.q, 0.3))
    data = read(cell, still, rng)
    assert calib.identify(cell, data).status == "rank_deficient"
    silent = replace(data, poses=replace(data.poses, order=None))
    with pytest.raises(EffectCannotAct, match="step:j3 cannot act: the poses have no time"):
        calib.identify(arm("step:j3"), silent)


@pytest.mark.parametrize("effect", SCENES)
def test_estimates_keep_their_tunings(effect: str, tmp_path: Path) -> None:
    cell = arm(effect)
    data, _ = SCENES[effect](cell, np.random.default_rng(9))
    found = estimate_of(calib.identify(cell, data))
    assert not found.undetermined
    fields = {"command": "identify", "estimate": Estimated.of(found).model_dump(by_alias=True)}
    (tmp_path / "result.json").write_text(json.dumps(fields))
    again = load_estimate(cell, tmp_path / "result.json")
    read_by = (own.model.predict(own.values, data.poses) for own in (again, found))
    np.testing.assert_allclose(*read_by, atol=1e-12)
    assert again.model.effects[-1].initial[0] == tuning(found)[0]
    assert again.clock_unit == data.poses.clock_unit


def test_targets_come_after_the_session() -> None:
    """A ripple is corrected where it is, a step has happened, and what was cold is warm.

    Rows in their order are the clock.
    """
    cell, rng = arm("warm_up:j1", "step:j1", "gear_ripple:j2"), np.random.default_rng(10)
    poses, count = session(cell, rng, 60), np.arange(60.0)
    dq = off_at(poses, 0, 3e-4 * (count > 30.5) + 2e-4 * np.exp(-count / 10.0))
    dq += off_at(poses, 1, 8e-5 * np.cos(150.0 * poses.q[:, 1]))
    result = calib.identify(cell, read(cell, poses, rng, dq))
    tau, moment, cycles = result.model.tunings
    assert [result.model.parameters[i].unit for i in (tau, moment)] == ["readings", "readings"]
    assert abs(result.values[tau] - 10.0) < 4.0 * result.std[tau]
    assert result.values[moment] == 30.5
    assert abs(result.values[cycles] - 150.0) < 4.0 * result.std[cycles]
    targets = session(cell, rng, 5)
    found = calib.compensate(cell, result, targets.q)
    expected = off_at(targets, 1, -8e-5 * np.cos(150.0 * targets.q[:, 1])) - [3e-4, 0, 0, 0]
    np.testing.assert_allclose(found.correction, expected, atol=1.5e-5)
    assert any("warm_up:j1, step:j1 counts as after it" in note for note in found.notes)


@pytest.mark.parametrize("scatters", [False, True])
@pytest.mark.parametrize("name", ["gear_ripple:A2", "warm_up:base", "step:A3"])
def test_a_scan_is_the_score_of_every_tuning(name: str, scatters: bool) -> None:
    cell, data, _, _ = day("kr270", "backlash:A3", 2e-4)
    stage = stage_of(cell, data)
    fit = stage.fit(())
    if scatters:
        n = cell.robot.dof
        known = Variances(1.2, np.full(n + 2, 1e-10), np.full(n + 2, 4e-10))
        scattered = replace(fit.observation, scatter=stage.scatter.at(known))
        fit = replace(fit, observation=scattered)
    effect = place_effect(*name.split(":"), context_of(cell, data.poses))
    assert isinstance(effect, Tuned)
    whole, values = fit.model.extended(fit.values, [effect.carrier])
    _, J = whole.jacobian(values, data.poses)
    carrier = fit.observation.rows(J[..., -len(effect.carrier.parameters) :])
    functions = effect.functions(data.poses, effect.grid(data.poses)[::7])
    limits = np.array([p.limit for p in effect.amplitudes])
    found = falls(carried(fit.linear.complement, carrier), functions, limits)
    r, J = fit.linear.independent
    N = J @ fit.span
    for fall, own in zip(found, functions, strict=True):
        rows = times(carrier, own)
        X = (rows if fit.mixing is None else fit.mixing(rows)).reshape(-1, rows.shape[-1])
        left = X - N @ np.linalg.lstsq(N, X, rcond=None)[0]
        lengths = np.linalg.norm(X, axis=0)
        expected, _ = score_test(left.T @ left, left.T @ r, lengths, limits)
        assert fall == pytest.approx(float(expected), rel=1e-6, abs=1e-9)
