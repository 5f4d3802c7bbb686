"""A MuJoCo model as the nominal robot, against MuJoCo's own kinematics and gravity torques."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from calib.arm.kinematics import forward, link_origins
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.errors import InputError
from calib.files.mjcf import load_mjcf
from calib.poses import poses_at
from tests.calib.mjcf_arms import random_mjcf
from tests.helpers import GRAVITY

CASES = [(dof, tip) for dof in (1, 2, 3, 6, 9) for tip in ("site", "body", "link")]


def in_mujoco(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The whole file as MuJoCo reads it."""
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def set_joints(model: mujoco.MjModel, data: mujoco.MjData, q: Array) -> list[int]:
    """Set j1 .. jn, all else at its reference; the degrees of freedom."""
    joints = [model.joint(f"j{k + 1}") for k in range(len(q))]
    data.qpos[:] = model.qpos0
    for joint, value in zip(joints, q, strict=True):
        data.qpos[joint.qposadr] = value
    mujoco.mj_forward(model, data)
    return [int(joint.dofadr[0]) for joint in joints]


def place(data: mujoco.MjData, name: str, tip: str) -> tuple[Array, Array]:
    element = data.site(name) if tip == "site" else data.body(name)
    return element.xmat.reshape(3, 3).copy(), element.xpos.copy()


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
    q = rng.uniform(-2, 2, (6, dof))
    frames = forward(robot, q)
    set_joints(model, data, q[0])
    R_base, p_base = place(data, "base", "body")
    gravity = R_base.T @ GRAVITY
    poses = poses_at(q)
    wrench = transmitted(
        robot, loads_of(robot, poses, Payload(), gravity), frames, link_origins(robot, frames, q)
    )
    for i, row in enumerate(q):
        dofs = set_joints(model, data, row)
        R, p = place(data, "tip", tip)
        np.testing.assert_allclose(R_base @ frames.o[i, -1] + p_base, p, atol=1e-12)
        np.testing.assert_allclose(R_base @ frames.R[i, -1], R, atol=1e-12)
        at_joints = wrench.local[i, 1:-1]
        ours = np.where(robot.prismatic[:, None], at_joints[:, :3], at_joints[:, 3:])
        np.testing.assert_allclose((ours * robot.axes).sum(1), -data.qfrc_bias[dofs], atol=1e-9)


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
    path = tmp_path / "scene.xml"
    robot = load_mjcf(path, "base", "tip")
    np.testing.assert_array_equal(robot.limits, [[-1.0, 2.0]])
    names = ["scene.xml", "parts/arm.xml", "parts/deep/link.xml"]
    assert [f.relative_to(tmp_path).as_posix() for f in robot.source.files] == names
    reference = mujoco.MjModel.from_xml_path(str(path))
    assert reference.body("tip").pos[2] == robot.origins[0, 2, 3] == 1.0


def test_a_mesh_gives_its_mass_where_nothing_else_does(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.3, 0], [0, 0, 0.6]])
    faces = ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "wedge.obj").write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {f}\n" for f in faces)
    )
    text = (
        '<mujoco><compiler meshdir="parts"/><asset><mesh file="wedge.obj"/></asset><worldbody>'
        '<body name="base"><body name="tip"><joint name="j1"/>'
        '<geom type="mesh" mesh="wedge" pos="0 0 1"/></body></body></worldbody></mujoco>'
    )
    (tmp_path / "arm.xml").write_text(text)
    robot = load_mjcf(tmp_path / "arm.xml", "base", "tip")
    # Vertices have single precision in MuJoCo.
    assert robot.masses[0] == pytest.approx(1000 * 0.2 * 0.3 * 0.6 / 6, rel=1e-6)
    np.testing.assert_allclose(robot.coms[0], corners.mean(0) + np.eye(3)[2], atol=1e-6)
    (tmp_path / "parts" / "wedge.obj").unlink()
    with pytest.raises(InputError, match=r"refused by MuJoCo: .*wedge.obj'; bring what it names"):
        load_mjcf(tmp_path / "arm.xml", "base", "tip")


GOOD = """<mujoco><compiler angle="radian"/><worldbody><body name="base">
<body name="link" pos="0 0 1"><joint name="j1" range="-1 1"/><geom size="0.1"/>
<body name="hand" pos="0 0 1"><joint name="j2" axis="1 0 0"/><geom size="0.1"/><site name="tip"/>
</body></body></body></worldbody></mujoco>"""
FINGER = '<body name="finger"><joint name="finger"/><geom size="0.1"/></body>'


def swap(old: str, new: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return edit


def equality(inside: str, more: str = "") -> Callable[[str], str]:
    return swap("</mujoco>", f"<equality>{inside}</equality>{more}</mujoco>")


BAD = {
    "not an MJCF": (lambda _: "<robot/>", "<robot>: is not an MJCF; name a file that holds"),
    "include leaves the folder": (
        swap("<compiler", '<include file="../secret.xml"/><compiler'),
        "include '../secret.xml': leaves the folder",
    ),
    "include is missing": (
        swap("<compiler", '<include file="no.xml"/><compiler'),
        "include 'no.xml': names no file",
    ),
    "include of itself": (
        swap("<compiler", '<include file="arm.xml"/><compiler'),
        "include 'arm.xml': is included already",
    ),
    "no such base": (
        swap('"base"', '"bas"'),
        "no body or site 'base'; set .* to one of: world, bas, link",
    ),
    "ball joint": (
        swap('name="j2"', 'type="ball"'),
        "joint 1 of hand: type 'ball' is not supported; use joints that turn or slide",
    ),
    "joint without a name": (swap('name="j2"', ""), "joint 1 of hand: has no name"),
    "copies without end": (
        swap("<site", '<replicate count="1000000000"><body/></replicate><site'),
        "<replicate>: makes 1000000000 copies; give a count of at most 10000",
    ),
    "coupled joints": (
        equality('<joint joint1="j1" joint2="j2"/>'),
        "equality <joint>: constrains joint 'j1' and joint 'j2'; closed loops and coupled",
    ),
    "closed loop": (
        equality('<connect body1="hand" anchor="0 0 0"/>'),
        "equality <connect>: constrains body 'hand'",
    ),
    "loop by sites": (
        lambda t: equality('<weld site1="tip" site2="x"/>')(
            swap("</worldbody>", '<site name="x"/></worldbody>')(t)
        ),
        "<weld>: constrains site 'tip'",
    ),
    "coupled by a tendon": (
        equality(
            '<tendon tendon1="t"/>',
            '<tendon><fixed name="t"><joint joint="j2" coef="1"/></fixed></tendon>',
        ),
        "equality <tendon>: constrains tendon 't'",
    ),
    "NaN": (swap("0 0 1", "0 nan 1"), "holds numbers that are not finite|refused by MuJoCo"),
    "misspelt attribute": (
        swap("axis=", "axes="),
        "refused by MuJoCo: .*unrecognized attr.*'axes'",
    ),
    "limits reversed": (swap("-1 1", "1 -1"), "joint j1 limit: lower 1.0 is above upper -1.0"),
}


@pytest.mark.parametrize("case", list(BAD))
def test_what_is_no_serial_chain_is_refused_in_one_line(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    edit, message = BAD[case]
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (tmp_path / "secret.xml").write_text("<mujoco/>")
    path = folder / "arm.xml"
    path.write_text(GOOD)
    assert load_mjcf(path, "base", "tip").dof == 2
    path.write_text(edit(GOOD))
    with pytest.raises(InputError) as caught:
        load_mjcf(path, "base", "tip")
    said = str(caught.value)
    assert re.search(message, said), said
    assert "\n" not in said
    assert said.startswith(str(folder))
    assert [p.name for p in folder.iterdir()] == ["arm.xml"], "MuJoCo writes no log"


@pytest.mark.parametrize(
    "edit",
    [
        equality('<joint joint1="j1" joint2="j2" active="false"/>'),
        lambda t: equality(
            '<joint joint1="finger" joint2="thumb"/>'
            '<connect body1="hand" body2="finger" anchor="0 0 0"/>'
        )(swap("<site", FINGER + FINGER.replace("finger", "thumb") + "<site")(t)),
        swap('<body name="base">', f'<body name="base">{FINGER}'),
        swap('<body name="base">', '<freejoint/><geom size="1"/><body name="base">'),
    ],
    ids=["inactive", "in the gripper", "a second arm", "a base that floats"],
)
def test_what_does_not_touch_the_chain_is_left_out(
    tmp_path: Path, edit: Callable[[str], str]
) -> None:
    path = tmp_path / "arm.xml"
    on_cart = swap('<body name="base">', '<body name="cart"><body name="base">')(GOOD)
    path.write_text(edit(swap("</worldbody>", "</body></worldbody>")(on_cart)))
    assert load_mjcf(path, "base", "tip").joints == ("j1", "j2")


def test_without_mujoco_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "arm.xml").write_text(GOOD)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        InputError, match=r"needs MuJoCo, which is not installed; pip install '\.\[sim\]'$"
    ):
        load_mjcf(tmp_path / "arm.xml", "base", "tip")
