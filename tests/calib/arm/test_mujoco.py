"""The corrected URDF against MuJoCo, which shares no code."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np

import calib
from calib import Cell, Poses
from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.files.robot_out import corrected_urdf
from calib.files.urdf import load_urdf
from tests.helpers import simulated, with_effects

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
