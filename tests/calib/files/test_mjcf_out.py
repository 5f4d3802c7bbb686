"""The corrected robot in MuJoCo's form and in URDF, against MuJoCo's own kinematics."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from calib import Cell
from calib.arm.kinematics import forward
from calib.arm.robot import Robot, Source
from calib.arrays import Array
from calib.files.mjcf import load_mjcf
from calib.files.robot_out import corrected_robot
from calib.files.urdf import load_urdf
from tests.calib.arm.test_mujoco import body_positions
from tests.calib.arm.test_mujoco import in_mujoco as urdf_in_mujoco
from tests.calib.files.test_mjcf import CASES, in_mujoco, place, set_joints
from tests.calib.mjcf_arms import random_mjcf
from tests.helpers import cell_of

MARKERS = {"m1": np.array([0.1, 0.0, 0.2]), "m2": np.array([0.0, -0.3, 0.0])}


def mjcf_cell(path: Path, base: str = "base", tip: str = "tip") -> Cell:
    robot = load_mjcf(path, base, tip)
    robot = replace(robot, source=Source("mjcf", (path,)))
    return cell_of(robot, np.zeros((1, 3)), ["base"])


def displaced_markers(robot: Robot, q: Array, corrections: Array) -> Array:
    """Markers in base axes, shape (m, 2, 3)."""
    own = corrections.copy()
    own[0] = 0.0  # the base is no part of the robot
    frames = forward(robot, q, own)
    points = np.array(list(MARKERS.values()))
    return np.einsum("mij,kj->mki", frames.R[:, -1], points) + frames.o[:, -1, None]


def markers_in_mujoco(text: str, robot: Robot, q: Array) -> Array:
    """Sites in the axes of the body ``base``, shape (m, 2, 3)."""
    model, data = in_mujoco(text)
    found = []
    for row in q:
        set_joints(model, data, row)
        R, p = place(data, "base", "body")
        points = np.array([data.site(f"marker_{name}").xpos for name in MARKERS])
        found.append((points - p) @ R)
    return np.array(found)


@pytest.mark.parametrize(("dof", "tip"), CASES)
def test_any_chain_can_be_corrected(tmp_path: Path, dof: int, tip: str) -> None:
    rng = np.random.default_rng([dof, len(tip), 1])
    path = tmp_path / "arm.xml"
    path.write_text(random_mjcf(rng, dof, tip))
    cell = mjcf_cell(path)
    corrections = rng.normal(size=(dof + 2, 6)) * 0.1
    q = rng.uniform(-2, 2, (6, dof))
    expected = displaced_markers(cell.robot, q, corrections)
    text = corrected_robot(cell, "mjcf", corrections, MARKERS, tmp_path / "out.xml").text
    np.testing.assert_allclose(markers_in_mujoco(text, cell.robot, q), expected, atol=1e-12)
    again = tmp_path / "again.xml"
    again.write_text(corrected_robot(cell, "mjcf", 0.0 * corrections, MARKERS, again).text)
    twice = corrected_robot(mjcf_cell(again), "mjcf", corrections, MARKERS, again).text
    np.testing.assert_allclose(markers_in_mujoco(twice, cell.robot, q), expected, atol=1e-12)

    out = tmp_path / "out.urdf"
    out.write_text(corrected_robot(cell, "urdf", corrections, MARKERS, out).text)
    frames = [load_urdf(out, "base", f"marker_{m}") for m in MARKERS]
    found = np.stack([forward(robot, q).o[:, -1] for robot in frames], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(frames[0].masses, cell.robot.masses, rtol=1e-14)
    np.testing.assert_allclose(frames[0].coms, cell.robot.coms, atol=1e-12)
    np.testing.assert_equal(frames[0].efforts, cell.robot.efforts)
    given = np.isfinite(cell.robot.limits)
    np.testing.assert_allclose(frames[0].limits[given], cell.robot.limits[given], rtol=1e-14)
    names = [f"marker_{m}" for m in MARKERS]
    in_mujoco_too = body_positions(urdf_in_mujoco(out.read_text()), names, q)
    np.testing.assert_allclose(in_mujoco_too, expected, atol=1e-9)


FILE = """<!-- A licence
of two lines -->
<mujoco model="own"><!-- kept -->
  <compiler angle="degree" assetdir="assets"/>
  <asset><mesh name="shell" file="shell.stl"/></asset>
  <worldbody>
    <body name="base">
      <body name="link" pos="0 0 0.5" euler="0 10 0">
        <joint name="j1" range="-90 90"/>
        <geom type="capsule" size="0.05 0.1"/>
        <body name="tip" pos="0 0 1"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="drive" joint="j1" kp="10"/></actuator>
  <keyframe><key name="home" qpos="0.1"/></keyframe>
</mujoco>
"""


def test_all_else_in_the_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(FILE)
    cell = mjcf_cell(path)
    corrections = np.zeros((3, 6))
    beside = corrected_robot(cell, "mjcf", corrections, {}, tmp_path / "out.xml").text
    plain = FILE.replace('"/>', '" />')
    assert beside == plain
    corrections[1, 0] = 1e-3
    moved = corrected_robot(cell, "mjcf", corrections, {}, tmp_path / "out.xml").text
    lost = [line for line in plain.splitlines() if line not in moved.splitlines()]
    assert [line.split()[1] for line in lost] == ['name="link"']
    model = mujoco.MjModel.from_xml_string(re.sub("<asset>.*</asset>", "", moved))
    assert model.key("home").qpos == [0.1]
    assert model.actuator("drive").id == 0


def test_meshes_are_found_from_another_folder(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(FILE)
    (tmp_path / "out").mkdir()
    target = tmp_path / "out" / "better.xml"
    target.write_text(corrected_robot(mjcf_cell(path), "mjcf", np.zeros((3, 6)), {}, target).text)
    with pytest.raises(ValueError, match=r"shell.stl"):
        mujoco.MjModel.from_xml_path(str(target))
    corners, faces = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"], ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]
    (tmp_path / "assets").mkdir()
    lines = [f"v {c}" for c in corners] + [f"f {f}" for f in faces]
    (tmp_path / "assets" / "shell.obj").write_text("\n".join(lines))
    target.write_text(target.read_text().replace("shell.stl", "shell.obj"))
    assert mujoco.MjModel.from_xml_path(str(target)).nmesh == 1


def test_a_urdf_as_mjcf(kr270: Cell, tmp_path: Path) -> None:
    """The same places to all digits, the same inertias, and no need for meshes."""
    rng = np.random.default_rng(3)
    urdf = kr270.robot_files[0].read_text()
    shape = '<visual><geometry><mesh filename="package://x/gone.dae"/></geometry></visual>'
    path = tmp_path / "arm.urdf"
    path.write_text(urdf.replace('<link name="link_3">', f'<link name="link_3">{shape}'))
    assert shape in path.read_text()
    cell = replace(kr270, robot=replace(kr270.robot, source=Source("urdf", (path,))))
    corrections = rng.normal(size=(8, 6)) * 1e-2
    text = corrected_robot(cell, "mjcf", corrections, MARKERS, tmp_path / "out.xml").text
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    q = rng.uniform(-1, 1, (5, 6))
    expected = displaced_markers(kr270.robot, q, corrections)
    for row, points in zip(q, expected, strict=True):
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        found = np.array([data.site(f"marker_{name}").xpos for name in MARKERS])
        np.testing.assert_allclose(found, points, atol=1e-12)
    np.testing.assert_allclose(model.body("link_2").mass, kr270.robot.masses[1], rtol=1e-6)
    (tmp_path / "out.xml").write_text(text)
    again = load_mjcf(tmp_path / "out.xml", "base_link", "tool0")
    assert again.joints == kr270.robot.joints
    whole = load_urdf(path, "base_link", "tool0")
    np.testing.assert_allclose(again.limits, whole.limits, rtol=1e-14)
