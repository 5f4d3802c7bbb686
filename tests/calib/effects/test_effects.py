"""Each effect against its defining formula, computed another way: moved joints, moved frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.arm.kinematics import forward
from calib.arm.se3 import displacement
from calib.arrays import Array
from calib.effects import EFFECTS, Context
from calib.effects.joint import error_unit
from calib.errors import EffectCannotAct
from calib.model import Model
from calib.poses import Poses
from tests.helpers import GRAVITY, model_of, random_context, random_poses, random_robot
from tests.plain_arm import tips

COUNT = 8


@pytest.fixture(params=[(), (1, 3)], ids=["turning", "sliding"])
def scene(request: pytest.FixtureRequest) -> tuple[Context, Poses]:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 5, request.param))
    return context, random_poses(rng, context.robot, COUNT)


def model_with(context: Context, kind: str, where: str) -> Model:
    return model_of(context, []).with_effects((EFFECTS[kind].at(context, where),))


def seen(context: Context, T: Array) -> Array:
    """Markers on tip frames T."""
    return np.einsum("mab,jb->mja", T[:, :3, :3], context.markers) + T[:, None, :3, 3]


@pytest.mark.parametrize("kind", ["transmission_scale", "joint_coupling", "backlash"])
def test_errors_of_a_drive(kind: str, scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    robot, q = context.robot, poses.q
    assert poses.approach is not None
    for k, where in enumerate(robot.joints):
        model = model_with(context, kind, where)
        values = np.linspace(1.0, 2.0, len(model.parameters)) * 1e-3
        others = [j for j in range(robot.dof) if j != k]
        dq = {
            "transmission_scale": values[0] * q[:, k],
            "joint_coupling": q[:, others] @ values if kind == "joint_coupling" else q[:, k],
            "backlash": values[0] * poses.approach[:, k],
        }[kind]
        moved = q.copy()
        moved[:, k] += dq
        expected = seen(context, tips(context.robot, moved))
        np.testing.assert_allclose(model.predict(values, poses), expected, atol=1e-12)
        assert model.parameters[0].unit.startswith(error_unit(bool(robot.prismatic[k])))


def test_names_and_units_of_a_coupling() -> None:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 3, (1,)))
    shown = [
        [(p.name, p.unit) for p in EFFECTS["joint_coupling"].at(context, w).parameters]
        for w in ("j1", "j2")
    ]
    assert shown == [
        [("from_j2", "urad/m"), ("from_j3", "urad/rad")],
        [("from_j1", "um/rad"), ("from_j3", "um/rad")],
    ]


def test_gear_harmonics(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    for where in EFFECTS["transmission_harmonic"].places(context):
        k = context.robot.joints.index(where)
        a, b, c, d = values = np.array([1e-3, -2e-3, 3e-3, 4e-3])
        model = model_with(context, "transmission_harmonic", where)
        assert [p.name for p in model.parameters] == ["cos_1", "sin_1", "cos_2", "sin_2"]
        q, moved = poses.q[:, k], poses.q.copy()
        moved[:, k] += a * np.cos(q) + b * np.sin(q) + c * np.cos(2 * q) + d * np.sin(2 * q)
        expected = seen(context, tips(context.robot, moved))
        np.testing.assert_allclose(model.predict(values, poses), expected, atol=1e-12)


def test_harmonics_belong_to_joints_that_turn() -> None:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 3, (1,)))
    assert EFFECTS["transmission_harmonic"].places(context) == ("j1", "j3")


@pytest.mark.parametrize("kind", ["base_drift", "tracker_drift"])
def test_drifts_move_everything_alike_and_start_at_the_first_pose(
    kind: str, scene: tuple[Context, Poses]
) -> None:
    context, poses = scene
    assert poses.time is not None
    poses = replace(poses, start=float(poses.time.min()))
    where = "base" if kind == "base_drift" else "instrument"
    model = model_with(context, kind, where)
    rates = np.array([1e-3, -2e-3, 3e-3, 2e-4, 1e-4, -3e-4])  # an hour
    scale = np.array([p.scale for p in model.parameters]) * 1e6
    nominal = seen(context, tips(context.robot, poses.q))
    D = displacement((poses.time - poses.time.min())[:, None] / 3600.0 * rates)
    expected = np.einsum("mab,mjb->mja", D[:, :3, :3], nominal) + D[:, None, :3, 3]
    read = model.predict(rates * scale, poses)
    np.testing.assert_allclose(read, expected, atol=1e-12)
    first = int(poses.time.argmin())
    np.testing.assert_allclose(read[first], nominal[first], atol=1e-12)


def test_scale_of_the_instrument_counts_from_its_origin(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    base, scale = EFFECTS["base"].at(context, "base"), EFFECTS["tracker_scale"]
    model = model_of(context, []).with_effects((base, scale.at(context, "instrument")))
    placed = np.array([3.0, -2.0, 1.0, 0.3, 0.2, -0.5])
    without = model.predict(np.append(placed, 0.0), poses)
    read = model.predict(np.append(placed, 2e-5), poses)
    np.testing.assert_allclose(read, without * (1.0 + 2e-5), atol=1e-12)


@pytest.mark.parametrize("where", ["arm", "j2", "j5"])
def test_links_grow_along_their_own_translation(where: str, scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    robot = context.robot
    assert poses.temperature is not None
    growth, expected = 12e-6, np.zeros((COUNT, len(context.markers), 3))
    grows = range(robot.dof + 1) if where == "arm" else [robot.joints.index(where) + 1]
    for i, kelvin in enumerate(poses.temperature - 20.0):
        origins = robot.origins.copy()
        for link in grows:
            origins[link, :3, 3] *= 1.0 + growth * kelvin
        warm = replace(context, robot=replace(robot, origins=origins))
        expected[i] = seen(warm, tips(warm.robot, poses.q[i : i + 1]))[0]
    model = model_with(context, "thermal_expansion", where)
    read = model.predict(np.array([growth]), poses)
    np.testing.assert_allclose(read, expected, atol=1e-12)
    assert np.abs(read - seen(context, tips(context.robot, poses.q))).max() > 1e-5


def test_sag_under_unknown_masses(scene: tuple[Context, Poses]) -> None:
    """The torque of random masses, by the statics of a robot that has them, at every joint."""
    from calib.arm.kinematics import link_origins
    from calib.arm.statics import Payload, loads_of, transmitted

    context, _ = scene
    robot = context.robot
    poses = random_poses(np.random.default_rng(8), robot, 60, loaded=False)
    frames = forward(robot, poses.q)
    loads = loads_of(robot, poses, Payload(), GRAVITY)
    wrench = transmitted(robot, loads, frames, link_origins(robot, frames, poses.q))
    for k, where in enumerate(robot.joints):
        model = model_with(context, "gravity_sag", where)
        part = slice(0, 3) if robot.prismatic[k] else slice(3, 6)
        torque = wrench.local[:, k + 1, part] @ robot.axes[k]
        none = np.zeros(len(model.parameters))
        ((_, basis),) = model.effects[0].twists(model.state(none, poses), none)
        X = np.einsum("i,mip->mp", robot.axes[k], basis[:, part])
        products, *_ = np.linalg.lstsq(X, torque * 1e-6, rcond=None)
        moved = poses.q.copy()
        moved[:, k] += 1e-6 * torque
        expected = seen(context, tips(context.robot, moved))
        np.testing.assert_allclose(model.predict(products, poses), expected, atol=1e-10)


def test_sag_of_the_arm_is_that_of_all_joints(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    arm = model_with(context, "gravity_sag", "arm")
    sag = EFFECTS["gravity_sag"]
    joints = arm.with_effects(tuple(sag.at(context, w) for w in context.robot.joints))
    values = np.random.default_rng(0).normal(size=len(arm.parameters)) * 1e-3
    np.testing.assert_allclose(
        arm.predict(values, poses), joints.predict(values, poses), atol=1e-12
    )
    assert len({p.name for p in arm.parameters}) == len(arm.parameters)


def test_scale_and_point_of_a_measured_load(scene: tuple[Context, Poses]) -> None:
    """What a wrench and a hung load do that are larger and hang elsewhere, first order at the given."""
    context, poses = scene
    context = replace(context, payload=replace(context.payload, mass=0.0))
    soft = [EFFECTS["joint_compliance"].at(context, w) for w in context.robot.joints]
    model = model_of(context, []).with_effects((*soft, EFFECTS["payload"].at(context, "payload")))
    compliance = np.full(context.robot.dof, 2e-6)
    plain = np.concatenate([compliance, np.zeros(4)])
    larger = replace(poses, wrench=1.2 * poses.wrench, load_mass=1.2 * poses.load_mass)
    np.testing.assert_allclose(
        model.predict(np.concatenate([compliance, [0.2, 0, 0, 0]]), poses),
        model.predict(plain, larger),
        atol=1e-9,
    )
    # Of a hung load alone, the shift of its point is exact.
    free = replace(poses, wrench=np.zeros_like(poses.wrench))
    shift = np.array([0.03, -0.02, 0.05])
    elsewhere = replace(free, load_com=free.load_com + shift)
    np.testing.assert_allclose(
        model.predict(np.concatenate([compliance, [0.0, *shift]]), free),
        model.predict(plain, elsewhere),
        atol=1e-9,
    )
    # A pure force at a point of the tip frame: its moment turns with the deflected tip.
    force = poses.wrench[:, :3]
    pure = replace(poses, wrench=np.column_stack([force, 0 * force]), load_mass=0 * poses.time)
    values = np.concatenate([compliance, [0.0, *shift]])
    state = model.state(values, pure)
    moment = np.cross(state.frames.R[:, -1] @ shift, force)
    known = replace(pure, wrench=np.column_stack([force, moment]))
    np.testing.assert_allclose(model.predict(values, pure), model.predict(plain, known), atol=2e-10)


def test_default_anchors_hold_the_link_up() -> None:
    """The default spring pulls a lying link up, whatever the robot's zero position and size."""
    from calib.model.build import context_of
    from studies.demo.embedded import embedded_cell

    context = context_of(embedded_cell(), None)
    robot = context.robot
    assert EFFECTS["gravity_compensator"].places(context) == robot.joints
    spring = EFFECTS["gravity_compensator"].at(context, "A2")
    np.testing.assert_allclose(
        np.linalg.norm(spring.anchors, axis=1), robot.reach * np.array([0.2, 0.05])
    )
    rng = np.random.default_rng(0)
    poses = random_poses(rng, robot, 30, loaded=False)
    preload = spring.wrench_basis(poses)[:, 2, 3:, 1] @ robot.axes[1]
    link = forward(robot, poses.q)
    out = link.o[:, 3] - link.o[:, 2]
    axis = np.einsum("mab,b->ma", link.R[:, 2], robot.axes[1])
    weight = np.einsum("ma,ma->m", axis, np.cross(out, GRAVITY))
    assert (preload * weight < 0.0).all()


def test_link_without_a_mass() -> None:
    rng = np.random.default_rng(2)
    robot = random_robot(rng, 3)
    context = random_context(rng, replace(robot, masses=np.array([5.0, 0.0, 1.0])))
    assert EFFECTS["link_weight"].places(context) == ("j1", "j3")
    with pytest.raises(EffectCannotAct, match=r"link_weight:j2 .*no mass to correct; add its <in"):
        EFFECTS["link_weight"].at(context, "j2")


def test_poses_that_do_not_say_leave_an_effect_at_rest(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    silent = replace(poses, time=None, temperature=None, approach=None, motion=None, torque=None)
    kinds = [kind for kind, effect in EFFECTS.items() if effect.uses and effect.places(context)]
    kinds.remove("step")  # poses of which the clock says nothing are after it
    model = model_of(context, kinds)
    nominal = seen(context, tips(context.robot, poses.q))
    values = model.initial + model.sizes
    np.testing.assert_allclose(model.predict(values, silent), nominal, atol=1e-12)
