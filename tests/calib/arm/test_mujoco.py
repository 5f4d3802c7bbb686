"""Kinematics, torques, equilibrium and the corrected URDF against MuJoCo, which shares no code."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.arm.kinematics import forward
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.files.urdf import load_urdf
from calib.files.urdf_out import corrected_urdf
from calib.model.build import build
from calib.poses import poses_at
from studies.demo.embedded import embedded_text, simulated
from tests.helpers import GRAVITY, with_effects

FLAGS = (
    '<mujoco><compiler fusestatic="false" discardvisual="false" boundmass="1e-9" '
    'boundinertia="1e-9"/></mujoco>'
)


def in_mujoco(urdf: str) -> mujoco.MjModel:
    """The model as MuJoCo reads it, with every fixed link kept."""
    text = re.sub(r"(<robot[^>]*>)", r"\1" + FLAGS, urdf, count=1)
    return mujoco.MjModel.from_xml_string(text)


def body_positions(model: mujoco.MjModel, names: list[str], q: Array) -> Array:
    """Origins of bodies in base axes, shape (m, len(names), 3)."""
    data = mujoco.MjData(model)
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in names]
    assert min(ids) >= 0
    out = []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        out.append(data.xpos[ids].copy())
    return np.array(out)


def torques(model: mujoco.MjModel, q: Array, tip: str, wrench: Array) -> Array:
    """Torque of weights and of a wrench at the tip on each joint, shape (m, n)."""
    data = mujoco.MjData(model)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, tip)
    out = []
    for row, w in zip(q, wrench, strict=True):
        data.qpos[:] = row
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        applied = np.zeros(model.nv)
        mujoco.mj_applyFT(model, data, w[:3], w[3:], data.xpos[body], body, applied)
        out.append(applied - data.qfrc_bias)
    return np.array(out)


@pytest.fixture(scope="module")
def poses(kr270: Cell) -> Poses:
    rng = np.random.default_rng(4)
    low, high = kr270.robot.limits.T
    q = rng.uniform(low, high, (20, 6))
    return poses_at(q, wrench=rng.normal(size=(20, 6)) * 500.0)


def test_equilibrium_of_elastic_joints(kr270: Cell, poses: Poses) -> None:
    """dq = compliance * torque at the deflected pose, found with MuJoCo's torques."""
    cell = with_effects(kr270, "joint_compliance")
    compliance = np.array([0.3, 0.28, 0.4, 2.8, 3.5, 2.1]) * 1e-6
    built = build(cell, poses).model
    frames = built.state(compliance, poses).frames
    model = in_mujoco(embedded_text("kr270.urdf"))
    model.opt.gravity[:] = GRAVITY
    q = poses.q
    for _ in range(20):
        q = poses.q + compliance * torques(model, q, "tool0", poses.wrench)
    assert np.abs(q - poses.q).max() > 1e-3, "the arm must deflect for this test to mean anything"
    expected = body_positions(model, ["tool0"], q)[:, 0]
    np.testing.assert_allclose(frames.o[:, -1], expected, atol=2e-9)


def test_wrong_masses_bend_the_arm_as_heavier_bodies_do(kr270: Cell) -> None:
    """A heavier link 3 and a heavier payload elsewhere, in MuJoCo's own bodies."""
    rng = np.random.default_rng(6)
    q = rng.uniform(*kr270.robot.limits.T, (10, 6))
    payload = Payload(50.0, (0.1, 0.0, 0.2))
    cell = replace(kr270, payload=payload)
    names = ("joint_compliance", "link_weight:A3", "payload")
    built = build(with_effects(cell, *names), poses_at(q)).model
    compliance = np.array([0.3, 0.28, 0.4, 2.8, 3.5, 2.1]) * 1e-6
    more, shift = 25.0, np.array([0.03, -0.02, 0.01])
    # To first order at the given mass: 60 kg here would act at the point that keeps the moment.
    mass = 60.0
    com = (mass * np.array(payload.com) + payload.mass * shift) / mass
    values = np.concatenate([compliance, [more], [mass - payload.mass], shift])
    tool = f'<inertial><origin xyz="{com[0]} {com[1]} {com[2]}"/><mass value="{mass}"/>'
    tool += '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    urdf = embedded_text("kr270.urdf").replace(
        '<link name="tool0"/>', f'<link name="tool0">{tool}</link>'
    )
    assert tool in urdf
    model = in_mujoco(urdf.replace('<mass value="190"/>', '<mass value="215"/>'))
    model.opt.gravity[:] = GRAVITY
    bent = q
    for _ in range(20):
        bent = q + compliance * torques(model, bent, "tool0", np.zeros((10, 6)))
    expected = body_positions(model, ["tool0"], bent)[:, 0]
    frames = built.state(values, poses_at(q)).frames
    np.testing.assert_allclose(frames.o[:, -1], expected, atol=2e-9)


def test_corrected_urdf_leads_to_the_same_markers(kr270: Cell, table_two: Poses) -> None:
    cell = with_effects(kr270, "base", "tool", "geometry")
    data, _, _ = simulated(cell, table_two, 3)
    result = calib.identify(cell, data)
    text = corrected_urdf(
        cell.robot_files[0],
        cell.robot,
        result.model.constant_displacements(result.values),
        dict(zip(cell.marker_names, result.marker_positions, strict=True)),
    )
    names = [f"marker_{name}" for name in cell.marker_names]
    in_base = body_positions(in_mujoco(text), names, data.poses.q)
    R, p = result.model.placement(result.values, data.poses)
    readings = np.einsum("mij,mkj->mki", R, in_base) + p[:, None]
    np.testing.assert_allclose(readings, result.model.predict(result.values, data.poses), atol=1e-9)


def test_corrected_urdf_without_tool_moves_the_tip(kr270: Cell, tmp_path: Path) -> None:
    """With known markers the last fixed joint is corrected; the file reads back as a robot."""
    rng = np.random.default_rng(1)
    corrections = rng.normal(size=(8, 6)) * 1e-3
    text = corrected_urdf(
        kr270.robot_files[0], kr270.robot, corrections, {"m": np.array([0.1, 0.0, 0.2])}
    )
    path = tmp_path / "out.urdf"
    path.write_text(text)
    again = load_urdf(path, "base_link", "tool0")
    q = rng.uniform(-1, 1, (5, 6))
    constant = corrections.copy()
    constant[0] = 0.0
    displaced = forward(kr270.robot, q, constant)
    np.testing.assert_allclose(forward(again, q).o[:, -1], displaced.o[:, -1], atol=1e-12)
    marker = displaced.o[:, -1] + displaced.R[:, -1] @ np.array([0.1, 0.0, 0.2])
    found = body_positions(in_mujoco(text), ["marker_m"], q)[:, 0]
    np.testing.assert_allclose(found, marker, atol=1e-9)
