"""Capsules about a URDF's collision shapes, against MuJoCo's own reading of the same file."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib.arm.enclosing import enclosing_capsule
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import InputError
from calib.files.shapes import mesh_vertices
from doe.constraints import constraints_of, scene_of
from doe.constraints.obstacles import Floor
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


def mesh_points(rng: np.random.Generator, size: Array) -> Array:
    return rng.uniform(-0.5, 0.5, (60, 3)) * size


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


CELL = cell_text('urdf = "arm.urdf"\nbase = "base_link"\ntip = "tool"')


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
    (own / "cell.toml").write_text(CELL)
    (own / "elbow.stl").write_bytes(stl(mesh_points(rng, np.array([300.0, 80.0, 60.0]))))
    corners = mesh_points(rng, np.array([0.1, 0.1, 0.3]))
    faces = [f"f {i} {i + 1} {i + 2}" for i in range(1, 58)]
    text = "\n".join([*(f"v {x} {y} {z}" for x, y, z in corners), *faces])
    (own / "slide.obj").write_text(text)
    return own


def load(folder: Path, *, robot: str = "", design: str = "", gravity: str = "") -> Cell:
    text = CELL.replace('tip = "tool"\n', f'tip = "tool"\n{robot}') + design + gravity
    (folder / "cell.toml").write_text(text)
    return calib.load_cell(folder / "cell.toml")


def in_mujoco(folder: Path) -> tuple[Any, Any]:
    text = (folder / "arm.urdf").read_text().replace("package://arm/", "")
    assets = {name: (folder / name).read_bytes() for name in ("elbow.stl", "slide.obj")}
    model = mujoco.MjModel.from_xml_string(text, assets)
    return model, mujoco.MjData(model)


def surface(model: Any, data: Any, g: int, rng: np.random.Generator) -> Array:
    """Points in a geom as MuJoCo has it, in the world."""
    kind, size = model.geom_type[g], model.geom_size[g]
    Geom = mujoco.mjtGeom
    if kind == Geom.mjGEOM_SPHERE:
        v = rng.normal(size=(500, 3))
        local = size[0] * v / np.linalg.norm(v, axis=1)[:, None]
    elif kind == Geom.mjGEOM_BOX:
        local = size * rng.choice([-1.0, 1.0], (500, 3))
    elif kind == Geom.mjGEOM_CYLINDER:
        turn = rng.uniform(0, 2 * np.pi, 500)
        z = size[1] * rng.choice([-1.0, 1.0], 500)
        local = np.column_stack([size[0] * np.cos(turn), size[0] * np.sin(turn), z])
    else:
        assert kind == Geom.mjGEOM_MESH
        at = model.geom_dataid[g]
        begin, count = model.mesh_vertadr[at], model.mesh_vertnum[at]
        local = np.array(model.mesh_vert[begin : begin + count])
    R = data.geom_xmat[g].reshape(3, 3)
    return np.asarray(local @ R.T + data.geom_xpos[g])


def test_every_shape_lies_in_a_capsule_at_every_pose(folder: Path) -> None:
    cell, rng = load(folder), np.random.default_rng(0)
    assert not cell.shapes.unread
    assert {name: len(own) for name, own in cell.shapes.capsules.items()} == {
        **dict.fromkeys(("base", "j1", "j2", "j3"), 1),
        "j4": 2,
    }
    model, data = in_mujoco(folder)
    q = rng.uniform(-1.5, 1.5, (20, 4))
    scene = scene_of(cell, q)
    slack = []
    for n in range(len(q)):
        data.qpos[:] = q[n]
        mujoco.mj_forward(model, data)
        for g in range(model.ngeom):
            points = surface(model, data, g, rng)
            away = [
                to_segment(points, c.start[n], c.end[n]).max() - c.radius for c in scene.capsules
            ]
            slack.append(min(away))
    assert max(slack) < 1e-6, "no point of a shape is outside its capsule"
    assert min(slack) > -0.02, "and the capsules are close about them"


def to_segment(points: Array, a: Array, b: Array) -> Array:
    along = b - a
    t = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - t[:, None] * along, axis=1))


@pytest.mark.parametrize("size", [(1, 1, 1), (1, 0.2, 0.1), (1, 1, 0.02), (0, 0, 1), (0, 0, 0)])
def test_a_capsule_holds_its_points_and_little_more(size: tuple[float, ...]) -> None:
    rng = np.random.default_rng(1)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = rng.uniform(-1.0, 1.0, (400, 3)) * size @ turn + [3.0, 0.0, -2.0]
    start, end, radius = enclosing_capsule(points)
    assert to_segment(points, start, end).max() <= radius
    cross = np.sort(size)[:2]
    assert radius <= 1.45 * np.linalg.norm(cross) + 1e-6
    assert np.linalg.norm(end - start) <= 2.05 * np.linalg.norm(size)


def constraint(cell: Cell, kind: type) -> object:
    found = [own for own in constraints_of(cell) if isinstance(own, kind)]
    return found[0] if found else None


@pytest.mark.parametrize(
    ("said", "height"),
    [
        ({"design": "[design]\nfloor_mm = -300.0\n"}, -0.3),
        ({}, None),
        ({"robot": "capsules_mm = {}\n"}, None),
    ],
)
def test_the_cell_says_otherwise(folder: Path, said: dict[str, str], height: float | None) -> None:
    cell = load(folder, **said)
    floor = constraint(cell, Floor)
    assert (floor.height if isinstance(floor, Floor) else None) == height
    assert bool(cell.shapes.capsules) is ("robot" not in said)


def test_what_cannot_be_read_is_named_and_left_out(folder: Path) -> None:
    (folder / "elbow.stl").unlink()
    text = (folder / "arm.urdf").read_text()
    text = text.replace('<sphere radius="0.09"/>', '<sphere radius="much"/>')
    (folder / "arm.urdf").write_text(text)
    cell = load(folder)
    assert set(cell.shapes.capsules) == {"base", "j2", "j4"}
    assert [own.split(" ")[0] for own in cell.shapes.unread] == ["shoulder", "elbow"]
    assert "is not there" in cell.shapes.unread[1]


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
    points = mesh_points(np.random.default_rng(5), np.ones(3))[:6].astype("<f4").astype(float)
    rows = "".join(f"  vertex {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    (tmp_path / "text.stl").write_text(f"solid s\nfacet\n{rows}endsolid")
    (tmp_path / "binary.STL").write_bytes(stl(points))
    for name in ("text.stl", "binary.STL"):
        np.testing.assert_array_equal(mesh_vertices(tmp_path / name), points)
