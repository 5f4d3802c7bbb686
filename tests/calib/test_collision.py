"""Capsules about collision shapes of a URDF and an MJCF, against MuJoCo's own reading of the file."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import InputError
from calib.files.shapes import enclosing_capsule, mesh_vertices
from doe.constraints import scene_of
from tests.helpers import cell_text

mujoco = pytest.importorskip("mujoco")

SHAPES = {
    "base_link": '<cylinder radius="0.1" length="0.2"/>@0 0 0.1@0 0 0',
    "shoulder": '<sphere radius="0.09"/>@0 0.02 0@0 0 0',
    "upper": '<box size="0.1 0.12 0.5"/>@0.03 0 0.2@0.1 0.2 -0.3',
    "elbow": '<mesh filename="package://arm/elbow.stl" scale="0.001 0.001 0.001"/>@0 0 0@0 0 0.4',
    "slide": '<mesh filename="slide.obj"/>@0 0 0.05@0 0 0',
    "tool": '<cylinder radius="0.03" length="0.2"/>@0 0 0.1@1.2 0 0',
}
JOINTS = (
    ("base_link", "shoulder", "j1", "revolute", "0 0 0.3", "0 0 1"),
    ("shoulder", "upper", "j2", "revolute", "0 0 0", "0 1 0"),
    ("upper", "elbow", "j3", "revolute", "0 0 0.5", "0 1 0"),
    ("elbow", "slide", "j4", "prismatic", "0.3 0 0", "1 0 0"),
    ("slide", "tool", "flange", "fixed", "0.1 0 0", "0 0 1"),
)
MJCF = """
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


def urdf() -> str:
    links = []
    for name, text in SHAPES.items():
        shape, xyz, rpy = text.split("@")
        links.append(
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
            'ixy="0" ixz="0" iyz="0"/></inertial><collision>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision></link>'
        )
    for parent, child, name, kind, xyz, axis in JOINTS:
        links.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="0 0 0.2"/><axis xyz="{axis}"/>'
            '<limit lower="-2" upper="2" effort="9" velocity="1"/></joint>'
        )
    compiler = '<mujoco><compiler discardvisual="false" fusestatic="false"/></mujoco>'
    return f'<robot name="arm">{compiler}{"".join(links)}</robot>'


def stl(points: Array) -> bytes:
    """Binary; triangles of three points after each other."""
    triangles = points.reshape(-1, 3, 3).astype("<f4")
    body = b"".join(struct.pack("<3f", 0, 0, 1) + t.tobytes() + b"\0\0" for t in triangles)
    return b"solid by a tool that lies".ljust(80) + struct.pack("<I", len(triangles)) + body


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(3)
    own = tmp_path / "arm"
    own.mkdir()
    (own / "arm.urdf").write_text(urdf())
    (own / "arm.xml").write_text(MJCF)
    elbow, slide = rng.uniform(-0.5, 0.5, (2, 60, 3)) * [[[300, 80, 60]], [[0.1, 0.1, 0.3]]]
    (own / "elbow.stl").write_bytes(stl(elbow))
    faces = [f"f {i} {i + 1} {i + 2}" for i in range(1, 58)]
    (own / "slide.obj").write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in slide), *faces]))
    return own


def load(folder: Path, form: str = "urdf", base: str = "base_link", more: str = "") -> Cell:
    """more : of [robot], or tables"""
    file = {"urdf": "arm.urdf", "mjcf": "arm.xml"}[form]
    text = cell_text(f'{form} = "{file}"\nbase = "{base}"\ntip = "tool"')
    at = text.replace("[markers_mm]", f"{more}[markers_mm]") if more[:1] != "[" else text + more
    (folder / "cell.toml").write_text(at)
    return calib.load_cell(folder / "cell.toml")


def surface(model: Any, data: Any, g: int, rng: np.random.Generator) -> Array:
    """Points on a geom as MuJoCo has it, in the world."""
    kind, size, Geom = model.geom_type[g], model.geom_size[g], mujoco.mjtGeom
    v = rng.normal(size=(500, 3))
    v /= np.linalg.norm(v, axis=1)[:, None]
    sides = rng.choice([-1.0, 1.0], (500, 3))
    if kind == Geom.mjGEOM_MESH:
        at = model.geom_dataid[g]
        begin, count = model.mesh_vertadr[at], model.mesh_vertnum[at]
        local = np.array(model.mesh_vert[begin : begin + count])
    elif kind == Geom.mjGEOM_BOX:
        local = size * sides
    elif kind == Geom.mjGEOM_ELLIPSOID:
        local = size * v
    elif kind == Geom.mjGEOM_CYLINDER:
        v[:, 2] = 0.0
        v /= np.linalg.norm(v, axis=1)[:, None]
        local = size[0] * v + [0.0, 0.0, size[1]] * sides
    else:
        assert kind == Geom.mjGEOM_SPHERE or kind == Geom.mjGEOM_CAPSULE
        local = size[0] * v + [0.0, 0.0, size[1] * (kind == Geom.mjGEOM_CAPSULE)] * sides
    return np.asarray(local @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g])


COUNTS = {
    "urdf": {"base": 1, "j1": 1, "j2": 1, "j3": 1, "j4": 2},
    "mjcf": {"base": 1, "j1": 1, "j2": 2, "j3": 1, "j4": 3},
}
BESIDE = ("world", "table")  # what is none of the arm's


@pytest.mark.parametrize(
    ("form", "base"), [("urdf", "base_link"), ("mjcf", "base"), ("mjcf", "world")]
)
def test_every_shape_lies_in_a_capsule_at_every_pose(folder: Path, form: str, base: str) -> None:
    cell, rng = load(folder, form, base), np.random.default_rng(0)
    assert not cell.shapes.unread
    assert {name: len(own) for name, own in cell.shapes.capsules.items()} == COUNTS[form]
    text = MJCF if form == "mjcf" else urdf().replace("package://arm/", "")
    assets = {name: (folder / name).read_bytes() for name in ("elbow.stl", "slide.obj")}
    model = mujoco.MjModel.from_xml_string(text, assets)
    data = mujoco.MjData(model)
    own = [
        g for g in range(model.ngeom) if model.geom_contype[g]
        and (form == "urdf" or model.body(model.geom_bodyid[g]).name not in BESIDE)
    ]  # fmt: skip
    low, high = cell.robot.limits.T
    q = rng.uniform(np.maximum(low, -1.5), np.minimum(high, 1.5), (20, 4))
    scene, slack = scene_of(cell, q), []
    for n in range(len(q)):
        data.qpos[:4] = q[n]
        mujoco.mj_forward(model, data)
        at = data.body(base) if form == "mjcf" else data.body("world")
        for g in own:
            points = (surface(model, data, g, rng) - at.xpos) @ at.xmat.reshape(3, 3)
            away = [outside(points, c.start[n], c.end[n], c.radius) for c in scene.capsules]
            slack.append(min(away))
    assert max(slack) < 1e-6, "no point of a shape is outside its capsule"
    close = 0.02 if form == "urdf" else 0.05  # an ellipsoid among them
    assert min(slack) > -close, "and the capsules are close about them"


def outside(points: Array, a: Array, b: Array, radius: float) -> float:
    """By how much the farthest of points is outside a capsule, m."""
    along = b - a
    t = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(points - a - t[:, None] * along, axis=1).max() - radius)


@pytest.mark.parametrize(
    ("size", "share"),
    [
        ((1, 1, 1), 0.66),
        ((1, 0.2, 0.1), 0.99),
        ((1, 1, 0.02), 0.86),
        ((0, 0, 1), 1),
        ((0, 0, 0), 1),
    ],
)
def test_a_capsule_holds_its_points_and_little_more(size: tuple[float, ...], share: float) -> None:
    """share : of the volume of a capsule along the longest edge of the box of points"""
    rng = np.random.default_rng(1)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = rng.uniform(-1.0, 1.0, (400, 3)) * size @ turn + [3.0, 0.0, -2.0]
    start, end, radius = enclosing_capsule(points)
    assert outside(points, start, end, radius) <= 0.0
    assert radius <= 1.45 * np.linalg.norm(np.sort(size)[:2]) + 1e-6
    assert np.linalg.norm(end - start) <= 2.05 * np.linalg.norm(size)
    thick, wide, long = 2.0 * np.sort(size)
    usual = volume(long, 0.5 * float(np.hypot(thick, wide)))
    assert volume(float(np.linalg.norm(end - start)), radius) <= share * usual + 1e-16


def volume(length: float, radius: float) -> float:
    return float(np.pi * radius**2 * (length + 4.0 / 3.0 * radius))


@pytest.mark.parametrize("more", ["", "capsules_mm = {}\n"])
def test_the_cell_says_otherwise(folder: Path, more: str) -> None:
    cell = load(folder, more=more)
    assert bool(cell.shapes.capsules) is ("capsules" not in more)


def test_what_cannot_be_read_is_named_and_left_out(folder: Path) -> None:
    (folder / "elbow.stl").unlink()
    path = folder / "arm.urdf"
    path.write_text(path.read_text().replace('<sphere radius="0.09"/>', '<sphere radius="much"/>'))
    cell = load(folder)
    assert set(cell.shapes.capsules) == {"base", "j2", "j4"}
    assert [own.split(" ")[0] for own in cell.shapes.unread] == ["shoulder", "elbow"]
    assert "is not there" in cell.shapes.unread[1]
    plane = '<geom type="plane" size="1 1 1"/><geom name="picture"'
    (folder / "arm.xml").write_text(MJCF.replace('<geom name="picture"', plane))
    assert load(folder, "mjcf", "base").shapes.unread == ("base (plane has no end)",)


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("a.stl", b"", "no vertices"),
        ("a.stl", b"solid x\nvertex 1 2 nan\n", "no vertices of a plausible size"),
        ("a.stl", b"solid x\nvertex 1 2\n", "no well-formed mesh"),
        ("a.obj", b"v 1 2 three", "no well-formed mesh"),
        ("a.dae", b"<COLLADA/>", "bring it as STL or OBJ"),
    ],
)
def test_no_mesh(tmp_path: Path, name: str, content: bytes, what: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=what):
        mesh_vertices(tmp_path / name)


def test_text_and_binary_stl_hold_the_same(tmp_path: Path) -> None:
    points = np.random.default_rng(5).uniform(-0.5, 0.5, (6, 3)).astype("<f4").astype(float)
    rows = "".join(f"  vertex {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    (tmp_path / "text.stl").write_text(f"solid s\nfacet\n{rows}endsolid")
    (tmp_path / "binary.STL").write_bytes(stl(points))
    for name in ("text.stl", "binary.STL"):
        np.testing.assert_array_equal(mesh_vertices(tmp_path / name), points)
