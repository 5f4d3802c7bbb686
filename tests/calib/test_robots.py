"""Robots as MJCF against MuJoCo's kinematics and torques, and as DH tables against plain numpy."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell
from calib.arm.kinematics import forward
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.errors import InputError
from calib.files.mjcf import load_mjcf
from calib.files.robot_out import corrected_robot
from calib.poses import poses_at
from tests.bad_inputs.edits import Edit, swap
from tests.bad_inputs.faults import SERIAL, tied
from tests.calib.test_trees import body_positions, felt
from tests.helpers import GRAVITY, cell_text
from tests.plain_arm import dh_pose
from tests.trees import random_mjcf

CASES = [(dof, tip) for dof in (1, 2, 3, 6, 9) for tip in ("site", "body", "link")]


def in_mujoco(text: str) -> tuple[Any, Any]:
    """The whole file as MuJoCo reads it."""
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def set_joints(model: Any, data: Any, q: Array) -> list[int]:
    """Set j1 .. jn, all else at its reference; the degrees of freedom."""
    joints = [model.joint(f"j{k + 1}") for k in range(len(q))]
    data.qpos[:] = model.qpos0
    for joint, value in zip(joints, q, strict=True):
        data.qpos[joint.qposadr] = value
    mujoco.mj_forward(model, data)
    return [int(joint.dofadr[0]) for joint in joints]


@pytest.mark.parametrize(("dof", "tip"), CASES)
def test_kinematics_limits_and_gravity_torques(tmp_path: Path, dof: int, tip: str) -> None:
    rng = np.random.default_rng([dof, len(tip)])
    text = random_mjcf(rng, dof, tip)
    (tmp_path / "arm.xml").write_text(text)
    robot = load_mjcf(tmp_path / "arm.xml", "base", "tip")
    assert robot.joints == tuple(f"j{k + 1}" for k in range(dof))
    model, data = in_mujoco(text)
    for k, name in enumerate(robot.joints):
        j = model.joint(name)
        assert tuple(robot.limits[k]) == (tuple(j.range) if j.limited[0] else (-np.inf, np.inf))
        np.testing.assert_equal(robot.efforts[k], 50.0 if model.jnt_actfrclimited[j.id] else np.nan)
    for row in rng.uniform(-2, 2, (6, dof)):
        dofs = set_joints(model, data, row)
        base, there = data.body("base"), data.site("tip") if tip == "site" else data.body("tip")
        R, frames = base.xmat.reshape(3, 3), forward(robot, row[None])
        np.testing.assert_allclose(R @ frames.o[0, -1] + base.xpos, there.xpos, atol=1e-12)
        np.testing.assert_allclose(R @ frames.R[0, -1], there.xmat.reshape(3, 3), atol=1e-12)
        ours = felt(robot, poses_at(row[None]), frames, Payload(), R.T @ GRAVITY)[0]
        np.testing.assert_allclose(ours, -data.qfrc_bias[dofs], atol=1e-9)


def test_world_may_be_the_base_and_a_moving_body_the_tip(tmp_path: Path) -> None:
    text = (
        '<mujoco><worldbody><body name="a" pos="1 2 3"><joint name="j1" pos="0 0.1 0" ref="20"/>'
        '<geom size="0.1"/></body></worldbody></mujoco>'
    )
    (tmp_path / "arm.xml").write_text(text)
    robot = load_mjcf(tmp_path / "arm.xml", "world", "a")
    model, data = in_mujoco(text)
    set_joints(model, data, np.array([0.7]))
    frames = forward(robot, np.array([[0.7]]))
    np.testing.assert_allclose(frames.o[0, -1], data.body("a").xpos, atol=1e-15)
    assert robot.name == "arm"


def test_includes_stand_in_their_place_and_are_named(tmp_path: Path) -> None:
    (tmp_path / "parts" / "deep").mkdir(parents=True)
    (tmp_path / "scene.xml").write_text('<mujoco><include file="parts/arm.xml"/></mujoco>')
    (tmp_path / "parts" / "arm.xml").write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body name="base">'
        '<include file="deep/link.xml"/></body></worldbody></mujoco>'
    )
    (tmp_path / "parts" / "deep" / "link.xml").write_text(
        '<mujocoinclude><body name="tip" pos="0 0 1"><joint name="j1" range="-1 2"/>'
        '<geom size="0.1"/></body></mujocoinclude>'
    )
    robot = load_mjcf(tmp_path / "scene.xml", "base", "tip")
    np.testing.assert_array_equal(robot.limits, [[-1.0, 2.0]])
    names = ["scene.xml", "parts/arm.xml", "parts/deep/link.xml"]
    assert [f.relative_to(tmp_path).as_posix() for f in robot.source.files] == names
    assert robot.origins[0, 2, 3] == 1.0


def test_a_mesh_gives_its_mass_where_nothing_else_does(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.3, 0], [0, 0, 0.6]])
    rows = [*(f"v {x} {y} {z}" for x, y, z in corners), "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "wedge.obj").write_text("\n".join(rows))
    (tmp_path / "arm.xml").write_text(
        '<mujoco><compiler meshdir="parts"/><asset><mesh file="wedge.obj"/></asset><worldbody>'
        '<body name="base"><body name="tip"><joint name="j1"/>'
        '<geom type="mesh" mesh="wedge" pos="0 0 1"/></body></body></worldbody></mujoco>'
    )
    robot = load_mjcf(tmp_path / "arm.xml", "base", "tip")
    # Vertices have single precision in MuJoCo.
    assert robot.masses[0] == pytest.approx(1000 * 0.2 * 0.3 * 0.6 / 6, rel=1e-6)
    np.testing.assert_allclose(robot.coms[0], corners.mean(0) + np.eye(3)[2], atol=1e-6)
    (tmp_path / "parts" / "wedge.obj").unlink()
    with pytest.raises(InputError, match=r"refused by MuJoCo: .*wedge.obj'; bring what it names"):
        load_mjcf(tmp_path / "arm.xml", "base", "tip")


# -- What does not touch the chain


def named(body: str) -> str:
    return f'<body name="{body}"><joint name="{body}"/><geom size="0.1"/></body>'


@pytest.mark.parametrize(
    "edit",
    [
        tied('joint joint1="j1" joint2="j2" active="false"'),
        swap('<body name="base">', f'<body name="base">{named("finger")}'),
        lambda text: tied(
            'joint joint1="thumb" joint2="gripper"/>'
            '<connect body1="hand" body2="thumb" anchor="0 0 0"'
        )(swap("<site", named("thumb") + named("gripper") + "<site")(text)),
        swap('<body name="base">', '<freejoint/><geom size="1"/><body name="base">'),
    ],
    ids=["inactive", "a second arm", "in the gripper", "a base that floats"],
)
def test_what_does_not_touch_the_chain_is_left_out(tmp_path: Path, edit: Edit) -> None:
    path = tmp_path / "arm.xml"
    on_cart = swap('<body name="base">', '<body name="cart"><body name="base">')(SERIAL)
    path.write_text(edit(swap("</worldbody>", "</body></worldbody>")(on_cart)))
    assert load_mjcf(path, "base", "tip").joints == ("j1", "j2")


def test_without_mujoco_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "arm.xml").write_text(SERIAL)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    said = r"needs MuJoCo, which is not installed; pip install '\.\[sim\]'$"
    with pytest.raises(InputError, match=said):
        load_mjcf(tmp_path / "arm.xml", "base", "tip")


# -- DH tables

TABLES = {
    "three parallel axes": """joint,alpha_deg,a_mm,theta_deg,d_mm
pan,90,0,0,162.5
lift,0,-425,0,0
elbow,0,-392.2,0,0
w1,90,0,0,133.3
w2,-90,0,0,99.7
w3,0,0,0,99.6
""",
    "stretched, alpha turned by 180": """joint,alpha_deg,a_mm,theta_deg,d_mm
A1,180,0,0,-645
A2,90,330,0,0
A3,0,1150,-90,0
A4,90,115,0,-1220
A5,-90,0,0,0
A6,90,0,180,-240
""",
    "a SCARA in other units": """joint,kind,d_m,theta_rad,a_mm,alpha_rad
J1,revolute,0.3,0.1,325,0
J2,revolute,0.05,-0.2,275,3.141592653589793
J3,prismatic,0.02,0,0,0
J4,revolute,0.01,0.3,0,0
""",
    "a gantry": """joint,kind,alpha_deg,a_m,theta_deg,d_mm
X,prismatic,-90,0.01,-90,12.5
Y,prismatic,90,0.02,90,0
B,revolute,0,0.1,0,50
C,revolute,30,0.2,45,10
""",
}


@pytest.mark.parametrize("convention", ["classic", "modified"])
@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
def test_the_chain_is_that_of_the_table(tmp_path: Path, table: str, convention: str) -> None:
    """And MuJoCo moves the URDF that is written from it likewise."""
    robot = f'dh = "arm.csv"\ndh_convention = "{convention}"'
    (tmp_path / "arm.csv").write_text(table)
    (tmp_path / "cell.toml").write_text(cell_text(robot))
    cell: Cell = calib.load_cell(tmp_path / "cell.toml")
    slides, tool = cell.robot.prismatic, np.array([0.05, 0.02, -0.1])
    q = np.random.default_rng(4).uniform(-1, 1, (6, len(slides))) * np.where(slides, 0.4, 3.0)
    frames = forward(cell.robot, q)
    constant = np.zeros((cell.robot.dof + 2, 6))
    made = corrected_robot(cell, constant, {"m": tool}, tmp_path / "x.urdf")
    moved = body_positions(made.text, ["marker_m"], q)[:, 0]
    for i, own in enumerate(q):
        T = dh_pose(table, convention, own)
        np.testing.assert_allclose(frames.R[i, -1], T[:3, :3], atol=1e-14)
        np.testing.assert_allclose(frames.o[i, -1], T[:3, 3], atol=1e-14)
        np.testing.assert_allclose(moved[i], (T @ [*tool, 1.0])[:3], atol=1e-12)
    assert (cell.robot.base, cell.robot.tip) == ("base", "tip")
    assert str(cell.robot.source) == "DH table"
    assert "made anew from the DH table" in made.lacks[0]
