"""The effects with a tuning, and those of the last move and of measured torques, by their formulas."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arm.se3 import displacement
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.effects import EFFECTS, Context
from calib.effects.ripple import GearRipple
from calib.effects.tuned import Tuned
from calib.errors import InputError
from calib.model import Model
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from tests.calib.effects.test_effects import model_with, seen
from tests.helpers import (
    measured_cell,
    model_of,
    random_context,
    random_poses,
    random_robot,
)
from tests.plain_arm import tips


@pytest.fixture
def scene() -> tuple[Context, Poses]:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 4, (1,)))
    poses = random_poses(rng, context.robot, 9)
    assert poses.time is not None
    return context, replace(poses, start=float(poses.time.min()))


def expected_at(context: Context, poses: Poses, k: int, dq: Array) -> Array:
    moved = poses.q.copy()
    moved[:, k] += dq
    return seen(context, tips(context.robot, moved))


def as_one(points: Array, xi: Array) -> Array:
    D = displacement(xi)
    return np.einsum("mab,mjb->mja", D[:, :3, :3], points) + D[:, None, :3, 3]


@pytest.mark.parametrize("harmonics", [1, 2])
def test_ripple(harmonics: int, scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    effect = GearRipple.at(context, "j3").with_harmonics(harmonics)
    model = model_of(context, []).with_effects((effect,))
    a, b, c, d = 1e-4, -2e-4, 5e-5, 3e-5
    values = np.array([123.4, a, b, c, d])[: 1 + 2 * harmonics]
    q = poses.q[:, 2]
    dq = a * np.cos(123.4 * q) + b * np.sin(123.4 * q)
    if harmonics == 2:
        dq += c * np.cos(246.8 * q) + d * np.sin(246.8 * q)
    expected = expected_at(context, poses, 2, dq)
    np.testing.assert_allclose(model.predict(values, poses), expected, atol=1e-12)
    names = [(p.name, p.unit) for p in model.parameters]
    assert names[:3] == [("cycles", "1/turn"), ("cos_1", "urad"), ("sin_1", "urad")]


def timed(context: Context, kind: str, where: str, poses: Poses) -> Model:
    return model_with(replace(context, clock_unit=poses.clock_unit), kind, where)


@pytest.mark.parametrize("clock", ["s", "reading"])
@pytest.mark.parametrize("kind", ["warm_up", "step"])
@pytest.mark.parametrize("where", ["base", "instrument", "j1", "j2"])
def test_what_follows_the_clock(
    kind: str, where: str, clock: str, scene: tuple[Context, Poses]
) -> None:
    context, poses = scene
    assert poses.time is not None
    t = poses.time - poses.time.min()
    if clock == "reading":
        order = np.random.default_rng(0).permutation(9)
        poses, t = replace(poses, time=None, order=order.astype(float)), order.astype(float)
    tuning = float(np.median(t)) + 0.1
    amount = np.exp(-t / tuning) if kind == "warm_up" else (t > tuning).astype(float)
    model = timed(context, kind, where, poses)
    plain = seen(context, tips(context.robot, poses.q))
    if where in context.robot.joints:
        values = np.array([tuning, 3e-4])
        expected = expected_at(context, poses, int(where[1]) - 1, 3e-4 * amount)
    else:
        xi = np.array([1e-4, -2e-4, 3e-4, 2e-5, 1e-5, -3e-5])
        values, expected = np.append(tuning, xi), as_one(plain, amount[:, None] * xi)
    np.testing.assert_allclose(model.predict(values, poses), expected, atol=1e-12)
    np.testing.assert_allclose(model.predict(model.initial, poses), plain, atol=1e-12)
    (first, *_) = model.parameters
    shown = {"warm_up": ("tau", "min"), "step": ("at", "s")}[kind]
    assert (first.name, first.unit) == (shown if clock == "s" else (shown[0], "readings"))


def test_one_marker_jumps(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    assert poses.time is not None
    t = poses.time - poses.time.min()
    moment, moved = float(np.median(t)) + 0.1, np.array([1e-4, -2e-4, 3e-4])
    model = timed(context, "step", "marker:m2", poses)
    T = tips(context.robot, poses.q)
    expected = seen(context, T)
    expected[:, 1] += np.where(t > moment, 1.0, 0.0)[:, None] * (T[:, :3, :3] @ moved)
    values = np.append(moment, moved)
    np.testing.assert_allclose(model.predict(values, poses), expected, atol=1e-12)


def test_settling_by_the_moves_themselves() -> None:
    rng = np.random.default_rng(4)
    context = random_context(rng, random_robot(rng, 3))
    q = rng.uniform(-1.0, 1.0, (12, 3))
    q[5] = q[4]  # read again without a move
    q[8, 1] = q[7, 1]  # one joint rests
    poses, dq = with_moves(poses_at(q)), np.zeros(12)
    came = np.zeros(3)
    for i in range(1, 12):
        came = q[i] - q[i - 1] if i != 5 else came
        dq[i] = -(2e-4 * came[1] + 3e-4 * came[1] / np.abs(came).max())
    model = model_with(context, "settling", "j2")
    expected = expected_at(context, poses, 1, dq)
    np.testing.assert_allclose(model.predict(np.array([2e-4, 3e-4]), poses), expected, atol=1e-12)
    assert [(p.name, p.unit) for p in model.parameters] == [
        ("per_move", "urad/rad"),
        ("per_speed", "urad"),
    ]


@pytest.mark.parametrize("where", ["j1", "j2"])
def test_friction_winds_up_the_compliance_of_its_joint(
    where: str, scene: tuple[Context, Poses]
) -> None:
    context, _ = scene
    light = replace(context, robot=replace(context.robot, masses=np.zeros(4)), payload=Payload())
    poses = random_poses(np.random.default_rng(5), light.robot, 9, loaded=False)
    assert poses.approach is not None
    kinds = ("friction_windup", "joint_compliance")
    model = model_of(light, []).with_effects(tuple(EFFECTS[k].at(light, where) for k in kinds))
    k = int(where[1]) - 1
    expected = expected_at(light, poses, k, -2e-6 * 30.0 * poses.approach[:, k])
    np.testing.assert_allclose(model.predict(np.array([30.0, 2e-6]), poses), expected, atol=1e-12)
    stiff = model.with_effects(model.effects[:1])
    _, J = stiff.jacobian(np.array([30.0]), poses)
    assert not J.any()


def test_measured_torque(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    assert poses.torque is not None
    for k, where in enumerate(context.robot.joints):
        model = model_with(context, "measured_torque", where)
        expected = expected_at(context, poses, k, 2e-6 * poses.torque[:, k])
        np.testing.assert_allclose(model.predict(np.array([2e-6]), poses), expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["gear_ripple", "warm_up", "step"])
def test_columns_are_functions_times_the_carrier(kind: str, scene: tuple[Context, Poses]) -> None:
    """What a scan over tunings builds on, at every place and several tunings at once."""
    context, poses = scene
    for where in EFFECTS[kind].places(context):
        effect = EFFECTS[kind].at(context, where)
        assert isinstance(effect, Tuned)
        tunings = np.array([[3.0, 500.0], [9000.0, 77.0]])
        F, slopes = effect.functions(poses, tunings), effect.slopes(poses, tunings)
        assert F.shape == slopes.shape == (2, 2, 9, F.shape[-1])
        model = model_of(context, []).with_effects((effect.carrier,))
        _, C = model.jacobian(model.initial, poses)
        for index in np.ndindex(2, 2):
            own = model.with_effects((effect.tuned(tunings[index]),))
            _, J = own.jacobian(own.initial, poses)
            assert not J[..., 0].any()
            built = F[index][:, None, None, :, None] * C[..., None, :]
            expected = built.reshape(*C.shape[:-1], -1)
            np.testing.assert_allclose(J[..., 1:], expected, atol=1e-12)


def test_grids() -> None:
    rng = np.random.default_rng(6)
    context = random_context(rng, random_robot(rng, 3))
    q = np.linspace(-1.0, 1.0, 41)[:, None] * np.ones(3)
    poses = with_moves(poses_at(q))
    ripple = GearRipple.at(context, "j1").grid(poses)
    np.testing.assert_allclose(np.diff(ripple), 2.0 * np.pi / 2.0 / 4.0)
    assert ripple[0] == 15.0
    assert 449.0 < ripple[-1] < 450.0
    geared = replace(context, gear_ratios={"j1": 100.0})
    np.testing.assert_array_equal(GearRipple.at(geared, "j1").grid(poses), [100.0, 200.0])
    by_row = replace(context, clock_unit="reading")
    moments = EFFECTS["step"].at(by_row, "base").grid(poses)  # type: ignore[attr-defined]
    np.testing.assert_allclose(moments, np.arange(1.5, 38.6))
    taus = EFFECTS["warm_up"].at(by_row, "base").grid(poses)  # type: ignore[attr-defined]
    assert len(taus) == 10
    np.testing.assert_allclose(taus[[0, -1]], [0.8, 80.0])
    still = poses_at(np.zeros((5, 3)))
    assert not len(GearRipple.at(context, "j1").grid(still))


def test_columns_of_torques(tmp_path: Path) -> None:
    folder = measured_cell(tmp_path)
    cell = calib.load_cell(folder / "cell.toml")
    table = folder / "measurements.csv"
    header, *rows = table.read_text().splitlines()
    joints = cell.robot.joints
    with_torques = tmp_path / "torques.csv"

    def write(names: list[str]) -> None:
        torques = [",".join(f"{hash_of(row, j):.3f}" for j in range(len(names))) for row in rows]
        lines = [f"{header},{','.join(names)}"]
        lines += [f"{row},{own}" for row, own in zip(rows, torques, strict=True)]
        with_torques.write_text("\n".join(lines) + "\n")

    def hash_of(row: str, j: int) -> float:
        return float(sum(map(ord, row.partition(",")[0])) % 97 + j)

    write([f"{j}_Nm" for j in joints])
    poses = calib.load_measurements(cell, with_torques).poses
    expected = [[hash_of(name, j) for j in range(6)] for name in poses.names]
    assert poses.torque is not None
    np.testing.assert_allclose(poses.torque, expected)
    assert calib.load_measurements(cell, table).poses.torque is None
    write([f"{j}_Nm" for j in joints[:-1]])
    with pytest.raises(InputError, match=f"'{joints[-1]}_Nm' is missing beside"):
        calib.load_measurements(cell, with_torques)


def test_gear_ratios_of_the_cell(tmp_path: Path) -> None:
    path = measured_cell(tmp_path) / "cell.toml"
    text = path.read_text()
    joint = calib.load_cell(path).robot.joints[1]
    path.write_text(f"{text}\n[robot.gear_ratio]\n{joint} = 121\n")
    assert calib.load_cell(path).gear_ratios == {joint: 121.0}
