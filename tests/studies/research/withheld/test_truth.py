"""The truth against the model it is to test, and each effect against its formula."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from calib.arrays import Array

pytest.importorskip("mujoco")

import calib
import studies.research.withheld
from studies.research.withheld.causes import Cause
from studies.research.withheld.effects import CATALOGUE
from studies.research.withheld.outside import OUTSIDE
from studies.research.withheld.robots import ARMS, HEAVY, RAIL, Arm
from studies.research.withheld.truth import G, frame_columns
from studies.research.withheld.visible import at_rest
from tests.studies.research.withheld.scenes import as_files, case_of, scene_of

ids = [arm.name for arm in ARMS]


def test_nothing_of_the_model_is_imported() -> None:
    own = "studies.research.withheld"
    for path in Path(next(iter(studies.research.withheld.__path__))).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "", *(f"{node.module}.{a.name}" for a in node.names)]
            for name in names:
                assert name.split(".")[0] not in ("calib", "doe"), f"{path.name}: {name}"
                assert not name.startswith("studies.") or name.startswith(own)


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


def effects_of(arm: Arm) -> dict[str, tuple[str, dict[str, float]]]:
    """One of each effect that does something to a joint: place, values and the sign of dq."""
    j, before = arm.names[-2], arm.names[-3]
    return {
        "joint_offset": (j, {"offset": 1e-4}),
        "joint_compliance": (j, {"compliance": 1e-6}),
        "transmission_harmonic": (j, {"cos_1": 1e-4, "sin_1": 2e-4, "cos_2": -1e-4, "sin_2": 3e-5}),
        "transmission_scale": (j, {"scale": 1e-4}),
        "joint_coupling": (j, {f"from_{before}": 1e-4}),
        "backlash": (j, {"half_width": 1e-4}),
    }


@pytest.mark.parametrize("effect", effects_of(HEAVY))
def test_errors_of_joint_variables(effect: str) -> None:
    """q_true = q_read + dq, dq written out here: the same points as an arm read so much further."""
    scene = scene_of(HEAVY)
    where, values = effects_of(HEAVY)[effect]
    state = case_of(scene, Cause(effect, where, values)).state
    k = HEAVY.names.index(where)
    q, session = scene.session.q[:, k], scene.session
    dq = {
        "joint_offset": np.full_like(q, 1e-4),
        "joint_compliance": 1e-6 * state.torque[:, k],
        "transmission_harmonic": 1e-4 * np.cos(q)
        + 2e-4 * np.sin(q)
        - 1e-4 * np.cos(2 * q)
        + 3e-5 * np.sin(2 * q),
        "transmission_scale": 1e-4 * q,
        "joint_coupling": 1e-4 * session.q[:, k - 1],
        "backlash": 1e-4 * session.approach[:, k],
    }[effect]
    moved = session.q + scene.compliance * state.torque
    moved[:, k] += dq
    expected = scene.mechanism().posed(moved).points
    np.testing.assert_allclose(state.points, expected, atol=1e-9)


def test_loads_turn_joints_by_hand() -> None:
    """Torque of a mass at a link, at the tip, and of a scaled wrench: arm x force along the axis."""
    scene = scene_of(HEAVY)
    k = 2
    still = at_rest(scene, scene.mechanism(), ())
    axis = still.R[:, k + 1] @ HEAVY.axes[k]
    weight = np.array([0.0, 0.0, -G])
    tip = still.o[:, -1]
    link = 3
    at_link = still.o[:, link + 1] + still.R_link[:, link + 1] @ np.array(HEAVY.joints[link].com)
    at_tip = tip + still.R_link[:, -1] @ scene.com
    about = {
        ("link_weight", HEAVY.names[link], "mass"): np.cross(at_link - still.o[:, k + 1], weight),
        ("payload", "payload", "mass"): np.cross(at_tip - still.o[:, k + 1], weight),
        ("payload", "payload", "scale"): scene.wrench[:, 3:]
        + np.cross(tip - still.o[:, k + 1], scene.wrench[:, :3]),
        ("payload", "payload", "com_y"): np.cross(
            still.R_link[:, -1, :, 1], weight * scene.payload
        ),
    }
    for (effect, where, name), moment in about.items():
        size = 1e-3
        state = case_of(scene, Cause(effect, where, {name: size})).state
        change = (state.torque - still.torque)[:, k]
        expected = size * np.sum(axis * moment, axis=1)
        np.testing.assert_allclose(change, expected, atol=0.02 * np.abs(expected).max())


def test_spring_pulls_the_links_together() -> None:
    """Torque of a spring from the change of its length, and its preload at zero angle."""
    scene = scene_of(HEAVY)
    assert HEAVY.spring is not None
    joint, before, after = HEAVY.spring
    k = HEAVY.names.index(joint)
    scene.compliance[k] = 1e-7
    values = {"spring": 2e4, "preload": 1e3}
    state = at_rest(scene, scene.mechanism(), ())
    action = CATALOGUE["gravity_compensator"](scene, state, joint, values)
    q = scene.session.q[:, k]

    def length(q: Array) -> Array:
        c, s = np.cos(q), np.sin(q)
        x, y, z = after
        turned = np.stack([c * x + s * z, y + 0 * q, -s * x + c * z], axis=-1)  # about +y
        return np.asarray(np.linalg.norm(turned - before, axis=-1))

    def energy(q: Array) -> Array:
        stretch = length(q) - length(np.zeros(1))
        return np.asarray(1e3 * stretch + 0.5 * 2e4 * stretch**2)

    torque = -(energy(q + 1e-5) - energy(q - 1e-5)) / 2e-5
    np.testing.assert_allclose(action.joint[:, k], 1e-7 * torque, rtol=1e-5, atol=1e-12)


def test_twists_by_hand() -> None:
    """Bearings, base, heat and tool: rigid displacements of what lies beyond, to first order."""
    scene = scene_of(RAIL)
    still = at_rest(scene, scene.mechanism(), ())
    k, c = 3, 1e-8
    frame = k + 1
    axis = RAIL.axes[k]
    moment = still.wrench[:, frame, 3:]
    tilt = c * (moment - np.outer(moment @ axis, axis))
    base = 1e-9 * still.wrench[:, 0, 3:] * [1.0, 1.0, 0.0]
    dT = scene.session.temperature - 20.0
    along = np.array(RAIL.joints[k + 1].xyz)  # these joints have no rpy: axes are those of the link
    hours = (scene.session.time - scene.session.time[0]) / 3600.0
    tip = still.wrench[:, -1] * np.array([0.0, 0.0, 1e-9, 1e-7, 0.0, 0.0])
    zero = np.zeros((scene.count, 3))
    drift = np.outer(hours, [1e-5, 2e-5, 0.0, 0.0, 0.0, 1e-5])
    expected = {
        ("bearing_compliance", RAIL.names[k], ("tilt",), (c,)): (frame, np.hstack([zero, tilt])),
        ("base_compliance", "base", ("tilt",), (1e-9,)): (0, np.hstack([zero, base])),
        ("thermal_expansion", RAIL.names[k], ("growth",), (1e-5,)): (
            k + 2,
            np.hstack([1e-5 * np.outer(dT, along), zero]),
        ),
        ("base_drift", "base", ("x", "y", "rz"), (1e-5, 2e-5, 1e-5)): (0, drift),
        ("tool_compliance", "tool", ("z", "rx"), (1e-9, 1e-7)): (RAIL.dof + 1, tip),
        ("link_geometry", RAIL.names[k], ("x", "ry"), (1e-5, 2e-5)): (
            frame,
            np.tile([1e-5, 0, 0, 0, 2e-5, 0], (scene.count, 1)),
        ),
    }
    for (effect, where, names, values), (at, twist) in expected.items():
        cause = Cause(effect, where, dict(zip(names, values, strict=True)))
        moved = case_of(scene, cause).state.points - still.points
        by_hand = np.einsum("nmij,nj->nmi", frame_columns(still, at), twist)
        assert np.abs(by_hand).max() > 1e-7
        np.testing.assert_allclose(
            moved, by_hand, atol=0.01 * np.abs(by_hand).max(), err_msg=effect
        )


def test_readings_by_hand() -> None:
    scene = scene_of(HEAVY)
    still = at_rest(scene, scene.mechanism(), ()).readings
    grown = case_of(scene, Cause("tracker_scale", "instrument", {"scale": 1e-5})).clean
    np.testing.assert_allclose(grown, still * (1.0 + 1e-5), atol=1e-12)
    hours = scene.session.hours[:, None]
    moved = case_of(scene, Cause("tracker_drift", "instrument", {"rz": 1e-5, "x": 1e-5})).clean
    np.testing.assert_allclose(
        (moved - still)[..., 0], 1e-5 * hours * (1.0 - still[..., 1]), atol=1e-12
    )


def test_stiffness_and_sag() -> None:
    scene = scene_of(HEAVY)
    where, k = "A3", 2
    scene.knots[where] = np.radians([-85.0, 0.0, 125.0])
    state = at_rest(scene, scene.mechanism(), ())
    values = {"compliance@-85": 1e-8, "compliance@0": 0.0, "compliance@125": 3e-8}
    dq = CATALOGUE["stiffness_vs_angle"](scene, state, where, values).joint[:, k]
    q = np.degrees(scene.session.q[:, k])
    share = np.where(q < 0, 1e-8 * q / -85.0, 3e-8 * q / 125.0)
    np.testing.assert_allclose(dq, share * state.torque[:, k], atol=1e-12)
    light = scene_of(HEAVY)
    weightless = type(light)(**{**light.__dict__, "weighs": False})
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


@pytest.mark.parametrize("name", OUTSIDE)
def test_causes_outside_move_something(name: str) -> None:
    scene = scene_of(RAIL)
    where = {"m": "marker:m1", "b": "instrument"}.get(name[0], "joint_3")
    where = "base" if name == "settling_base" else where
    values = {"a": 1e-5, "b": 1e-5 if name == "third_harmonic" else 0.5, "x": 1e-5, "y": 0, "z": 0}
    still = at_rest(scene, scene.mechanism(), ()).readings
    moved = case_of(scene, Cause(name, where, values)).clean - still
    assert 1e-8 < np.abs(moved).max() < 0.1
