"""Each effect against its defining formula, computed another way: moved joints, moved frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arm.kinematics import forward, link_origins
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.effects import EFFECTS, Context
from calib.effects.joint import error_unit
from calib.effects.ripple import GearRipple
from calib.effects.tuned import Tuned
from calib.errors import EffectCannotAct, InputError
from calib.model import Model
from calib.model.build import context_of
from calib.poses import Poses, poses_at
from calib.poses.moves import with_moves
from studies.demo.embedded import embedded_cell
from tests.helpers import (
    GRAVITY,
    measured_cell,
    model_of,
    random_context,
    random_poses,
    random_robot,
)
from tests.plain_arm import tips


@pytest.fixture(params=[(), (1, 3)], ids=["turning", "sliding"])
def scene(request: pytest.FixtureRequest) -> tuple[Context, Poses]:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 5, request.param))
    poses = random_poses(rng, context.robot, 8)
    assert poses.time is not None
    return context, replace(poses, start=float(poses.time.min()))


def model_with(context: Context, kind: str, where: str) -> Model:
    return model_of(context, []).with_effects((EFFECTS[kind].at(context, where),))


def seen(context: Context, T: Array) -> Array:
    """Markers on tip frames T."""
    return np.einsum("mab,jb->mja", T[:, :3, :3], context.markers) + T[:, None, :3, 3]


def moved_joint(context: Context, poses: Poses, k: int, dq: Array) -> Array:
    q = poses.q.copy()
    q[:, k] += dq
    return seen(context, tips(context.robot, q))


Formula = Callable[[Poses, int, Array], Array]


def _settling(poses: Poses, k: int, v: Array) -> Array:
    move = np.asarray(poses.approach) * np.asarray(poses.motion)
    return -(v[0] * move[:, k] + v[1] * move[:, k] / np.abs(move).max(axis=1))


def _turned(poses: Poses, k: int, v: Array) -> Array:
    q = poses.q[:, k]
    return v[0] * np.cos(q) + v[1] * np.sin(q) + v[2] * np.cos(2 * q) + v[3] * np.sin(2 * q)


def _rippled(poses: Poses, k: int, v: Array) -> Array:
    q = v[0] * poses.q[:, k]
    return v[1:] @ [np.cos(q), np.sin(q), np.cos(2.0 * q), np.sin(2.0 * q)][: len(v) - 1]


def _clock(poses: Poses) -> Array:
    return np.asarray(poses.time) - poses.start


RIPPLE = ("cycles", "cos_1", "sin_1", "cos_2", "sin_2")
DQ: dict[str, Formula] = {
    "joint_offset": lambda poses, k, v: v[0] * np.ones(len(poses)),
    "transmission_scale": lambda poses, k, v: v[0] * poses.q[:, k],
    "transmission_harmonic": _turned,
    "joint_coupling": lambda poses, k, v: np.delete(poses.q, k, axis=1) @ v,
    "backlash": lambda poses, k, v: v[0] * np.asarray(poses.approach)[:, k],
    "settling": _settling,
    "measured_torque": lambda poses, k, v: v[0] * np.asarray(poses.torque)[:, k],
    "gear_ripple": _rippled,
    "warm_up": lambda poses, k, v: v[1] * np.exp(-_clock(poses) / v[0]),
    "step": lambda poses, k, v: v[1] * (_clock(poses) > v[0]),
}
"""Error of a joint's variable by the poses, the joint and the values."""
TUNED = {"gear_ripple": 123.4, "warm_up": 4e3, "step": 9e3}


@pytest.mark.parametrize(
    ("kind", "names"), [*((kind, None) for kind in DQ), ("gear_ripple", RIPPLE)]
)
def test_errors_along_a_joint(
    kind: str, names: tuple[str, ...] | None, scene: tuple[Context, Poses]
) -> None:
    """Nothing where a search begins. Other places: tests/studies/research/sealed/test_truth.py."""
    context, poses = scene
    context = replace(context, parameters=names)
    nominal = seen(context, tips(context.robot, poses.q))
    for where in set(context.robot.joints) & set(EFFECTS[kind].places(context)):
        k = context.robot.joints.index(where)
        model = model_with(context, kind, where)
        values = np.linspace(1.0, 2.0, len(model.parameters)) * 1e-4
        if kind in TUNED:
            values[0] = TUNED[kind]
        expected = moved_joint(context, poses, k, DQ[kind](poses, k, values))
        np.testing.assert_allclose(model.predict(values, poses), expected, atol=1e-12)
        np.testing.assert_allclose(model.predict(model.initial, poses), nominal, atol=1e-12)
        if kind != "measured_torque":
            unit = model.parameters[1 if kind in TUNED else 0].unit
            assert unit.startswith(error_unit(bool(context.robot.prismatic[k])))


def test_names_units_and_places() -> None:
    rng = np.random.default_rng(2)
    context = random_context(rng, random_robot(rng, 3, (1,)))

    for kind, where, at, expected in (
        ("joint_coupling", "j1", 0, ("from_j2", "urad/m", 1e-6)),
        ("joint_coupling", "j1", 1, ("from_j3", "urad/rad", 1e-6)),
        ("joint_coupling", "j2", 0, ("from_j1", "um/rad", 1e-6)),
        ("settling", "j1", 0, ("per_move", "urad/rad", 1e-6)),
        ("settling", "j1", 1, ("per_speed", "urad", 1e-6)),
        ("joint_compliance", "j2", 0, ("compliance", "nm/N", 1e-9)),
        ("gravity_compensator", "j1", 0, ("spring", "N/mm", 1e3)),
        ("gravity_compensator", "j1", 1, ("preload", "N", 1.0)),
        ("base_drift", "base", 3, ("rx", "urad/h", 1e-6 / 3600.0)),
        ("warm_up", "base", 0, ("tau", "min", 60.0)),
        ("step", "j1", 0, ("at", "s", 1.0)),
        ("step", "j1", 1, ("offset", "urad", 1e-6)),
        ("gear_ripple", "j1", 0, ("cycles", "1/turn", 1.0)),
        ("gear_ripple", "j1", 1, ("cos_1", "urad", 1e-6)),
    ):
        p = EFFECTS[kind].at(context, where).parameters[at]
        assert (p.name, p.unit, p.scale) == expected
    assert EFFECTS["transmission_harmonic"].places(context) == ("j1", "j3")


@pytest.mark.parametrize("kind", ["gear_ripple", "warm_up", "step"])
def test_columns_are_functions_times_the_carrier(kind: str, scene: tuple[Context, Poses]) -> None:
    """What a scan over tunings builds on, at every place and several tunings at once."""
    context, poses = scene
    for where in EFFECTS[kind].places(context):
        effect = EFFECTS[kind].at(context, where)
        assert isinstance(effect, Tuned)
        tunings = np.array([[3.0, 500.0], [9000.0, 77.0]])
        F, slopes = effect.functions(poses, tunings), effect.slopes(poses, tunings)
        assert F.shape == slopes.shape == (2, 2, 8, F.shape[-1])
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
    poses = with_moves(poses_at(np.linspace(-1.0, 1.0, 41)[:, None] * np.ones(3)))

    def grid(kind: str, where: str, **of: object) -> Array:
        effect = EFFECTS[kind].at(replace(context, clock_unit="reading", **of), where)
        assert isinstance(effect, Tuned)
        return effect.grid(poses)

    ripple = grid("gear_ripple", "j1")
    np.testing.assert_allclose(np.diff(ripple), 2.0 * np.pi / 2.0 / 4.0)
    assert ripple[0] == 15.0
    assert 449.0 < ripple[-1] < 450.0
    np.testing.assert_array_equal(grid("gear_ripple", "j1", gear_ratios={"j1": 100.0}), [100, 200])
    np.testing.assert_allclose(grid("step", "base"), np.arange(1.5, 38.6))
    np.testing.assert_allclose(grid("warm_up", "base"), np.geomspace(0.8, 80.0, 10))
    assert not len(GearRipple.at(context, "j1").grid(poses_at(np.zeros((5, 3)))))


def late(temperature: Array, time: Array, lag: float) -> Array:
    """What nears a temperature, held since the reading before: ``dT/dt = (temperature - T) / lag``."""
    T = temperature[:1].copy()
    for now, step in zip(temperature[1:], np.diff(time), strict=True):
        T = np.append(T, now + (T[-1] - now) * 2.0 ** (-step / (lag * np.log(2.0))))
    return T


@pytest.mark.parametrize("lag", [0.0, 1200.0])
@pytest.mark.parametrize("where", ["arm", "j2", "j5"])
def test_links_grow_along_their_own_translation(
    where: str, lag: float, scene: tuple[Context, Poses]
) -> None:
    context, poses = scene
    time = np.cumsum(np.random.default_rng(4).uniform(60.0, 600.0, len(poses)))
    poses = with_moves(replace(poses, time=time))
    assert poses.temperature is not None
    heat = late(poses.temperature, time, lag) if lag else poses.temperature
    robot, growth = context.robot, 12e-6
    expected = np.zeros((8, len(context.markers), 3))
    grows = range(robot.dof + 1) if where == "arm" else [robot.joints.index(where) + 1]
    for i, kelvin in enumerate(heat - 20.0):
        origins = robot.origins.copy()
        for link in grows:
            origins[link, :3, 3] *= 1.0 + growth * kelvin
        warm = replace(context, robot=replace(robot, origins=origins))
        expected[i] = seen(warm, tips(warm.robot, poses.q[i : i + 1]))[0]
    names = ("lag", "growth") if lag else ("growth",)
    model = model_with(replace(context, parameters=names), "thermal_expansion", where)
    assert [p.name for p in model.parameters] == list(names)
    read = model.predict(np.array([lag, growth])[-len(names) :], poses)
    np.testing.assert_allclose(read, expected, atol=1e-12)
    assert np.abs(read - seen(context, tips(context.robot, poses.q))).max() > 1e-5


def test_sag_under_unknown_masses(scene: tuple[Context, Poses]) -> None:
    """The torque of random masses, by the statics of a robot that has them, at every joint."""
    context, _ = scene
    robot = context.robot
    poses = random_poses(np.random.default_rng(8), robot, 60, loaded=False)
    frames = forward(robot, poses.q)
    loads = loads_of(robot, poses, Payload(), GRAVITY)
    wrench = transmitted(robot, loads, frames, link_origins(robot, frames, poses.q))
    dq, found = np.zeros_like(poses.q), []
    for k, where in enumerate(robot.joints):
        model = model_with(context, "gravity_sag", where)
        part = slice(0, 3) if robot.prismatic[k] else slice(3, 6)
        dq[:, k] = 1e-6 * wrench.local[:, k + 1, part] @ robot.axes[k]
        none = np.zeros(len(model.parameters))
        ((_, basis),) = model.effects[0].twists(model.state(none, poses), none)
        X = np.einsum("i,mip->mp", robot.axes[k], basis[:, part])
        found.append(np.linalg.lstsq(X, dq[:, k])[0])
        expected = moved_joint(context, poses, k, dq[:, k])
        np.testing.assert_allclose(model.predict(found[-1], poses), expected, atol=1e-10)
    arm = model_with(context, "gravity_sag", "arm")
    assert len({p.name for p in arm.parameters}) == len(arm.parameters)
    sagged = seen(context, tips(robot, poses.q + dq))
    np.testing.assert_allclose(arm.predict(np.concatenate(found), poses), sagged, atol=1e-10)


def test_scale_and_point_of_a_measured_load(scene: tuple[Context, Poses]) -> None:
    """What a wrench and a hung load do that are larger and hang elsewhere, first order at the given."""
    context, poses = scene
    context = replace(context, payload=replace(context.payload, mass=0.0))
    soft = [EFFECTS["joint_compliance"].at(context, w) for w in context.robot.joints]
    model = model_of(context, []).with_effects((*soft, EFFECTS["payload"].at(context, "payload")))

    def read(poses: Poses, *load: float) -> Array:
        return model.predict(np.array([*[2e-6] * context.robot.dof, *load]), poses)

    larger = replace(poses, wrench=1.2 * poses.wrench, load_mass=1.2 * poses.load_mass)
    np.testing.assert_allclose(read(poses, 0.2, 0, 0, 0), read(larger, 0, 0, 0, 0), atol=1e-9)
    # Of a hung load alone, the shift of its point is exact.
    free = replace(poses, wrench=np.zeros_like(poses.wrench))
    shift = np.array([0.03, -0.02, 0.05])
    elsewhere = replace(free, load_com=free.load_com + shift)
    np.testing.assert_allclose(read(free, 0, *shift), read(elsewhere, 0, 0, 0, 0), atol=1e-9)
    # A pure force at a point of the tip frame: its moment turns with the deflected tip.
    force = poses.wrench[:, :3]
    pure = replace(poses, wrench=np.column_stack([force, 0 * force]), load_mass=0 * poses.warming)
    state = model.state(np.array([*[2e-6] * context.robot.dof, 0.0, *shift]), pure)
    moment = np.cross(state.frames.R[:, -1] @ shift, force)
    known = replace(pure, wrench=np.column_stack([force, moment]))
    np.testing.assert_allclose(read(pure, 0, *shift), read(known, 0, 0, 0, 0), atol=2e-10)


def test_default_anchors_hold_the_link_up() -> None:
    """The default spring pulls a lying link up, whatever the robot's zero position and size."""
    context = context_of(embedded_cell(), None)
    robot = context.robot
    assert EFFECTS["gravity_compensator"].places(context) == robot.joints
    spring = EFFECTS["gravity_compensator"].at(context, "A2")
    away = np.linalg.norm(spring.anchors, axis=1)
    np.testing.assert_allclose(away, robot.reach * np.array([0.2, 0.05]))
    poses = random_poses(np.random.default_rng(0), robot, 30, loaded=False)
    preload = spring.wrench_basis(poses, robot.frame_count)[:, 2, 3:, 1] @ robot.axes[1]
    link = forward(robot, poses.q)
    out = link.o[:, 3] - link.o[:, 2]
    axis = np.einsum("mab,b->ma", link.R[:, 2], robot.axes[1])
    weight = np.einsum("ma,ma->m", axis, np.cross(out, GRAVITY))
    assert (preload * weight < 0.0).all()


def test_poses_that_do_not_say_leave_an_effect_at_rest(scene: tuple[Context, Poses]) -> None:
    context, poses = scene
    silent = replace(poses, time=None, temperature=None, approach=None, motion=None, torque=None)
    kinds = [kind for kind, effect in EFFECTS.items() if effect.uses and effect.places(context)]
    kinds.remove("step")  # poses of which the clock says nothing are after it
    model = model_of(context, kinds)
    nominal = seen(context, tips(context.robot, poses.q))
    values = model.initial + model.sizes
    np.testing.assert_allclose(model.predict(values, silent), nominal, atol=1e-12)


def test_link_without_a_mass() -> None:
    rng = np.random.default_rng(2)
    robot = random_robot(rng, 3)
    context = random_context(rng, replace(robot, masses=np.array([5.0, 0.0, 1.0])))
    assert EFFECTS["link_weight"].places(context) == ("j1", "j3")
    with pytest.raises(EffectCannotAct, match=r"link_weight:j2 .*no mass to correct; add its <in"):
        EFFECTS["link_weight"].at(context, "j2")


def test_columns_of_torques_and_gear_ratios(tmp_path: Path) -> None:
    folder = measured_cell(tmp_path)
    path = folder / "cell.toml"
    path.write_text(f"{path.read_text()}\n[robot.gear_ratio]\nA2 = 121\n")
    cell = calib.load_cell(path)
    assert cell.gear_ratios == {"A2": 121.0}
    assert calib.load_measurements(cell, folder / "measurements.csv").poses.torque is None
    header, *rows = (folder / "measurements.csv").read_text().splitlines()
    torques = {row.partition(",")[0]: float(len(row) % 7) for row in rows}

    def loaded(count: int) -> calib.Poses:
        more = [[torques[row.partition(",")[0]] + j for j in range(count)] for row in rows]
        lines = [f"{row},{','.join(map(str, own))}" for row, own in zip(rows, more, strict=True)]
        names = [f"{joint}_Nm" for joint in cell.robot.joints[:count]]
        (tmp_path / "torques.csv").write_text("\n".join([",".join([header, *names]), *lines, ""]))
        return calib.load_measurements(cell, tmp_path / "torques.csv").poses

    poses = loaded(6)
    expected = [[torques[name] + j for j in range(6)] for name in poses.names]
    np.testing.assert_allclose(np.asarray(poses.torque), expected)
    with pytest.raises(InputError, match="'A6_Nm' is missing beside"):
        loaded(5)
