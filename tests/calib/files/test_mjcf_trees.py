"""MJCFs with several tips against MuJoCo: read, and written with corrections."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Robot
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.files.cell import load_cell
from calib.files.mjcf import load_mjcf
from calib.files.robot_out import corrected_robot
from calib.poses import poses_at
from tests.calib.arm.test_mujoco import FLAGS
from tests.calib.files.test_trees import cell_text
from tests.helpers import GRAVITY
from tests.trees import random_tree, tips_of, urdf

SEEDS = range(50)


def as_mjcf(text: str) -> str:
    """A URDF as MuJoCo saves it."""
    spec = mujoco.MjSpec.from_string(re.sub(r"(<robot[^>]*>)", r"\1" + FLAGS, text, count=1))
    spec.compile()
    return str(spec.to_xml())


def written(folder: Path, seed: int) -> tuple[Path, str, list[str]]:
    """The file of a random tree, its tip and others."""
    joints, chain = random_tree(seed)
    tip = f"c{len(chain)}"
    path = folder / "tree.xml"
    path.write_text(as_mjcf(urdf(joints)))
    return path, tip, tips_of(joints, tip, seed)


def stand(model: Any, data: Any, robot: Robot, q: Array) -> None:
    data.qpos[:] = 0.0
    data.qpos[[int(model.joint(name).qposadr[0]) for name in robot.joints]] = q
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize("seed", SEEDS)
def test_tips_and_torques_are_those_of_mujoco(tmp_path: Path, seed: int) -> None:
    path, tip, others = written(tmp_path, seed)
    robot = load_mjcf(path, "c0", tip, others)
    assert robot.tips == (*others, tip)
    model: Any = mujoco.MjModel.from_xml_path(str(path))
    model.opt.gravity = GRAVITY
    data: Any = mujoco.MjData(model)
    dofs = [int(model.joint(name).dofadr[0]) for name in robot.joints]
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, (3, robot.dof))
    frames = forward(robot, q)
    for i, row in enumerate(q):
        stand(model, data, robot, row)
        R, p = data.body("c0").xmat.reshape(3, 3), data.body("c0").xpos
        loads = loads_of(robot, poses_at(q), Payload(), R.T @ GRAVITY)
        local = transmitted(robot, loads, frames, link_origins(robot, frames, q)).local
        along = local[i, 1 : robot.dof + 1]
        felt = np.where(robot.prismatic[:, None], along[:, :3], along[:, 3:])
        ours = (felt * robot.axes).sum(axis=-1)
        np.testing.assert_allclose(ours, -data.qfrc_bias[dofs], atol=1e-9)
        for number, name in enumerate(robot.tips, robot.dof + 1):
            there = data.body(name)
            np.testing.assert_allclose(R @ frames.o[i, number] + p, there.xpos, atol=1e-12)
            turn = R @ frames.R[i, number]
            np.testing.assert_allclose(turn, there.xmat.reshape(3, 3), atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_a_corrected_tree_leads_to_the_same_markers_in_mujoco(tmp_path: Path, seed: int) -> None:
    _, tip, (other, *_) = written(tmp_path, seed)
    (tmp_path / "cell.toml").write_text(cell_text(other, 'mjcf = "tree.xml"', tip=tip))
    cell = load_cell(tmp_path / "cell.toml")
    assert cell.robot.tips == (other, tip)
    rng = np.random.default_rng(seed)
    corrections = rng.normal(size=(cell.robot.frame_count, 6)) * 1e-2
    corrections[0] = 0.0
    markers = dict(zip(cell.marker_names, cell.markers, strict=True))
    text = corrected_robot(cell, "mjcf", corrections, markers, tmp_path / "out.xml").text
    (tmp_path / "out.xml").write_text(text)
    model: Any = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    data: Any = mujoco.MjData(model)
    q = rng.uniform(-1.0, 1.0, (4, cell.robot.dof))
    frames = forward(cell.robot, q, corrections)
    for i, row in enumerate(q):
        stand(model, data, cell.robot, row)
        R, p = data.body("c0").xmat.reshape(3, 3), data.body("c0").xpos
        for name, frame in zip(cell.marker_names, cell.marker_frames, strict=True):
            ours = frames.o[i, frame] + frames.R[i, frame] @ markers[name]
            there = data.site(f"marker_{name}").xpos
            np.testing.assert_allclose(R @ ours + p, there, atol=1e-9)


def test_shapes_go_with_the_joint_that_carries_them(tmp_path: Path) -> None:
    """On every branch, whatever its joints are numbered."""
    path, tip, others = written(tmp_path, 5)
    (tmp_path / "cell.toml").write_text(cell_text(others[0], 'mjcf = "tree.xml"', tip=tip))
    cell = load_cell(tmp_path / "cell.toml")
    robot, model = cell.robot, mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (1, robot.dof))
    stand(model, data, robot, q[0])
    frames = forward(robot, q)
    origins = link_origins(robot, frames, q)
    R, p = data.body("c0").xmat.reshape(3, 3), data.body("c0").xpos
    balls = data.geom_xpos
    for frame, joint in enumerate(robot.joints, 1):
        for capsule in robot.shapes.capsules.get(joint, ()):
            ends = np.array([capsule.start, capsule.end])
            at = ends @ frames.R_link[0, frame].T + origins[0, frame]
            near = np.linalg.norm(balls - (R @ at[0] + p), axis=1).min()
            assert near < capsule.radius + 1e-9


@pytest.mark.parametrize(
    ("on", "said"),
    [
        ("c99", "has no body or site 'c99'; set 'on' of what it carries to a site, or to one of"),
        ("root", "no chain of bodies leads from 'c0' to it"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(tmp_path: Path, on: str, said: str) -> None:
    from calib.errors import InputError

    _, tip, _ = written(tmp_path, 3)
    (tmp_path / "cell.toml").write_text(cell_text(on, 'mjcf = "tree.xml"', tip=tip))
    with pytest.raises(InputError) as error:
        load_cell(tmp_path / "cell.toml")
    assert said in str(error.value)
    assert "\n" not in str(error.value)
