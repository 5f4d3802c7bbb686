"""Capsules about an MJCF's collision geoms, against MuJoCo's own distances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.cell import Cell
from doe.constraints import scene_of
from tests.calib.files.test_collision import to_segment
from tests.helpers import cell_text

mujoco = pytest.importorskip("mujoco")

ARM = """
<mujoco model="arm"><compiler angle="radian" autolimits="true"/>
<asset><mesh name="wedge" vertex="0 0 0  .2 0 0  0 .12 0  0 0 .3  .1 .1 .1" scale="1 1 0.8"/></asset>
<worldbody>
  <geom name="floor" type="plane" size="3 3 .1"/>
  <body name="table" pos="1 1 0"><geom type="box" size=".3 .3 .2"/></body>
  <body name="base" pos="0 0 .2" euler="0 0 .4">
    <geom type="cylinder" size=".1 .15" pos="0 0 .05"/>
    <geom name="picture" type="box" size="1 1 1" contype="0" conaffinity="0"/>
    <body name="b1" pos="0 0 .3" euler="0 0 .1">
      <joint name="j1" axis="0 0 1" pos=".02 .01 0" range="-2 2"/>
      <geom type="sphere" size=".09" pos="0 .02 0" mass="1"/>
      <body name="b2" pos="0 .05 0">
        <joint name="j2" axis="0 1 0" range="-2 2"/>
        <geom type="box" size=".05 .06 .25" pos=".03 0 .2" euler=".1 .2 -.3"/>
        <body name="held" pos=".1 0 .2" euler="0 .5 0">
          <geom type="ellipsoid" size=".05 .12 .03" euler=".3 0 0"/>
        </body>
        <body name="b3" pos="0 0 .5">
          <joint name="j3" axis="0 1 0" range="-2 2" ref=".3"/>
          <geom type="mesh" mesh="wedge" euler="0 0 .4"/>
          <body name="b4" pos=".3 0 0">
            <joint name="j4" type="slide" axis="1 0 0" pos="0 .1 0" range="-.3 .3"/>
            <geom type="capsule" size=".03" fromto="0 0 0 .2 0 .05"/>
            <body name="tool" pos=".1 0 0" euler="0 1 0">
              <geom type="cylinder" size=".02 .1" euler="1.2 0 0"/>
              <body name="finger"><joint name="grip"/><geom type="sphere" size=".02"/></body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </body>
</worldbody></mujoco>
"""
CELL = cell_text('mjcf = "arm.xml"\nbase = "BASE"\ntip = "tool"')
OURS = ("base", "b1", "b2", "held", "b3", "b4", "tool", "finger")


def load(folder: Path, base: str, arm: str = ARM) -> Cell:
    (folder / "arm.xml").write_text(arm)
    (folder / "cell.toml").write_text(CELL.replace("BASE", base))
    return calib.load_cell(folder / "cell.toml")


def with_probes(arm: str, count: int) -> Any:
    """The same arm, and balls that may be put anywhere."""
    ball = '<body name="p{}" mocap="true"><geom name="p{}" type="sphere" size="1e-3"/></body>'
    balls = "".join(ball.format(k, k) for k in range(count))
    return mujoco.MjModel.from_xml_string(arm.replace("</worldbody>", f"{balls}</worldbody>"))


@pytest.mark.parametrize("base", ["base", "world"])
def test_what_touches_a_geom_is_in_a_capsule(tmp_path: Path, base: str) -> None:
    """Balls about the arm: where MuJoCo says that one meets a geom, it meets a capsule, and no capsule
    is far about its geom."""
    cell = load(tmp_path, base)
    assert not cell.shapes.unread
    sizes = {name: len(own) for name, own in cell.shapes.capsules.items()}
    assert sizes == {"base": 1, "j1": 1, "j2": 2, "j3": 1, "j4": 3}
    rng, count = np.random.default_rng(0), 40
    model = with_probes(ARM, count)
    data = mujoco.MjData(model)
    theirs = [
        g for g in range(model.ngeom) if model.body(model.geom_bodyid[g]).name in OURS
        and model.geom_contype[g]
    ]  # fmt: skip
    low, high = cell.robot.limits.T
    q = rng.uniform(low, high, (6, 4))
    scene = scene_of(cell, q)
    to_base = np.eye(4)
    touched, apart = 0, []
    for n, row in enumerate(q):
        data.qpos[:4] = row
        mujoco.mj_kinematics(model, data)
        near = data.geom_xpos[rng.choice(theirs, count)]
        data.mocap_pos[:] = near + rng.normal(size=(count, 3)) * 0.15
        mujoco.mj_forward(model, data)
        if base != "world":
            to_base = np.eye(4)
            to_base[:3, :3] = data.body("base").xmat.reshape(3, 3).T
            to_base[:3, 3] = -to_base[:3, :3] @ data.body("base").xpos
        for k in range(count):
            probe = to_base[:3, :3] @ data.mocap_pos[k] + to_base[:3, 3]
            geom = min(
                mujoco.mj_geomDistance(model, data, g, model.geom(f"p{k}").id, 5.0, None)
                for g in theirs
            )
            ours = (
                min(
                    to_segment(probe[None], c.start[n], c.end[n])[0] - c.radius
                    for c in scene.capsules
                )
                - 1e-3
            )
            assert ours <= geom + 2e-4
            touched += geom <= 0.0
            apart.append(geom - ours)
    assert touched > 5
    assert np.max(apart) < 0.15


def test_a_plane_on_the_arm_is_named(tmp_path: Path) -> None:
    arm = ARM.replace(
        '<geom name="picture"', '<geom type="plane" size="1 1 1"/><geom name="picture"'
    )
    assert load(tmp_path, "base", arm).shapes.unread == ("base (plane has no end)",)
