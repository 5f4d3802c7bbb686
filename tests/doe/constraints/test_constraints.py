"""Constraints and line of sight, against MuJoCo, which shares no code, and against cases by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import Cell, load_cell
from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Robot
from calib.arm.se3 import so3_exp, transform
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.cell import Capsule, Load
from calib.cell.planned import Ball, Box, HalfSpace
from calib.errors import CalibError
from calib.poses import hung, poses_at
from doe.constraints import Constraint, constraints_of, scene_of, visible
from doe.constraints.distances import (
    point_box,
    point_segment,
    segment_box,
    segment_halfspace,
    segment_segment,
)
from doe.constraints.scene import Scene
from doe.constraints.self_collision import SelfCollision
from doe.constraints.torque import static_torques
from studies.demo.embedded import embedded_text
from tests.helpers import GRAVITY, cell_of, designed, random_robot, read_by

CAPSULE, SPHERE, BOX = (
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_BOX,
)


# Distances ---------------------------------------------------------------------------------------


class TwoShapes:
    """Two geoms of MuJoCo, moved at will."""

    def __init__(self, first: str, second: str) -> None:
        geoms = "".join(f'<geom type="{kind}" size="1 1 1"/>' for kind in (first, second))
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option ccd_tolerance="1e-12" ccd_iterations="200"/>'
            f"<worldbody>{geoms}</worldbody></mujoco>"
        )
        self.data = mujoco.MjData(self.model)

    def place(self, geom: int, size: Array, position: Array, R: Array) -> None:
        self.model.geom_size[geom] = size
        self.data.geom_xpos[geom] = position
        self.data.geom_xmat[geom] = R.ravel()

    def capsule(self, geom: int, start: Array, end: Array, radius: float) -> None:
        half = np.array([radius, 0.5 * np.linalg.norm(end - start), 0.0])
        self.place(geom, half, 0.5 * (start + end), along_z(end - start))

    def distance(self) -> float:
        return mujoco.mj_geomDistance(self.model, self.data, 0, 1, 100.0, None)


def along_z(direction: Array) -> Array:
    """A rotation whose z axis has this direction."""
    R, _ = Rotation.align_vectors(direction[None], [[0.0, 0.0, 1.0]])
    return R.as_matrix()


def segments(seed: int, count: int) -> tuple[Array, Array]:
    """Segments of all lengths around the origin."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2.0, 2.0, (count, 3))
    return start, start + rng.normal(size=(count, 3)) * rng.uniform(0.01, 2.0, (count, 1))


def test_segments_against_mujoco() -> None:
    a, b = segments(1, 300)
    c, d = segments(2, 300)
    oracle, expected = TwoShapes("capsule", "capsule"), []
    for ends in zip(a, b, c, d, strict=True):
        oracle.capsule(0, ends[0], ends[1], 0.01)
        oracle.capsule(1, ends[2], ends[3], 0.01)
        expected.append(oracle.distance() + 0.02)
    np.testing.assert_allclose(segment_segment(a, b, c, d), expected, atol=1e-7)


def test_points_against_mujoco() -> None:
    a, b = segments(3, 200)
    points, _ = segments(4, 200)
    oracle, expected = TwoShapes("capsule", "sphere"), []
    for start, end, point in zip(a, b, points, strict=True):
        oracle.capsule(0, start, end, 0.01)
        oracle.place(1, np.array([0.01, 0.0, 0.0]), point, np.eye(3))
        expected.append(oracle.distance() + 0.02)
    np.testing.assert_allclose(point_segment(points, a, b), expected, atol=1e-7)


def test_boxes_against_mujoco() -> None:
    a, b = 0.6 * np.array(segments(5, 300))
    half = np.array([0.3, 0.7, 0.5])
    oracle, expected = TwoShapes("capsule", "box"), []
    oracle.place(1, half, np.zeros(3), np.eye(3))
    for start, end in zip(a, b, strict=True):
        oracle.capsule(0, start, end, 1e-3)
        expected.append(oracle.distance() + 1e-3)
    # Where a capsule runs right through a box, MuJoCo may call them apart; samples know better.
    through = (point_box(sampled(a, b), half) == 0.0).any(axis=0)
    ours, theirs = segment_box(a, b, half), np.array(expected)
    assert 20 < through.sum() < 280
    np.testing.assert_allclose(ours[~through], theirs[~through], atol=1e-6)
    assert (ours[through] <= 1e-12).all()


def sampled(a: Array, b: Array, count: int = 4001) -> Array:
    """Points along segments, shape (count, n, 3)."""
    return a + np.linspace(0.0, 1.0, count)[:, None, None] * (b - a)


def test_distances_against_dense_sampling() -> None:
    """The least over samples is never below the distance, and above it by less than half a step."""
    a, b = segments(6, 200)
    c, d = segments(7, 200)
    half, normal = np.array([0.2, 0.9, 0.4]), np.array([1.0, -2.0, 0.5])
    step = np.linalg.norm(b - a, axis=1) / 4000
    x = sampled(a, b)
    height = (x - np.array([0.1, 0.2, 0.3])) @ normal / np.linalg.norm(normal)
    cases = [
        (segment_box(a, b, half), point_box(x, half)),
        (segment_segment(a, b, c, d), point_segment(x, c, d)),
        (segment_halfspace(a, b, np.array([0.1, 0.2, 0.3]), normal), np.maximum(-height, 0.0)),
    ]
    for exact, along in cases:
        nearest = along.min(axis=0)
        assert (exact <= nearest + 1e-12).all()
        assert (nearest - exact <= 0.5 * step + 1e-12).all()
        assert (exact > 0.01).sum() > 20


def test_box_is_exact() -> None:
    """The nearest point of a segment, found by halving the interval where the slope changes sign."""
    a, b = segments(8, 500)
    half = np.array([0.3, 0.7, 0.5])

    def outside(t: Array) -> Array:
        x = a + t[:, None] * (b - a)
        return x - np.clip(x, -half, half)

    low, high = np.zeros(500), np.ones(500)
    for _ in range(80):
        middle = 0.5 * (low + high)
        rises = np.einsum("ni,ni->n", outside(middle), b - a) > 0.0
        low, high = np.where(rises, low, middle), np.where(rises, middle, high)
    expected = np.linalg.norm(outside(high), axis=1)
    np.testing.assert_allclose(segment_box(a, b, half), expected, atol=1e-12)


def test_point_box_by_hand() -> None:
    half = np.array([1.0, 2.0, 3.0])
    points = np.array([[0.5, -1.0, 2.9], [1.5, 0.0, 0.0], [4.0, 6.0, 0.0], [-3.0, -4.0, 4.0]])
    np.testing.assert_allclose(point_box(points, half), [0.0, 0.5, 5.0, 3.0], atol=1e-15)


def test_degenerate_segments() -> None:
    """Points, parallel, collinear and crossing segments, in either order."""
    o, x, y, z = np.zeros(3), *np.eye(3)
    cases = [
        (o, o, x, x, 1.0),  # two points
        (o, x, 0.5 * x + y, 0.5 * x + y, 1.0),  # a point beside a segment
        (o, 2 * x, x + y, 4 * x + y, 1.0),  # parallel, side by side in part
        (o, x, 4 * x + 4 * y, 8 * x + 4 * y, 5.0),  # parallel, one after the other
        (o, x, 8 * x + 4 * y, 4 * x + 4 * y, 5.0),  # the same, opposite directions
        (o, x, 3 * x, 5 * x, 2.0),  # in line
        (o, 2 * x, x, 5 * x, 0.0),  # in line, overlapping
        (-x, x, -y + 0.25 * z, y + 0.25 * z, 0.25),  # crossing
        (o, x, o, x, 0.0),
    ]
    a, b, c, d, expected = (np.array(column) for column in zip(*cases, strict=True))
    np.testing.assert_allclose(segment_segment(a, b, c, d), expected, atol=1e-12)
    np.testing.assert_allclose(segment_segment(c, d, a, b), expected, atol=1e-12)
    np.testing.assert_allclose(segment_segment(b, a, c, d), expected, atol=1e-12)
    half = np.array([0.5, 0.5, 0.5])
    np.testing.assert_allclose(segment_box(3 * x, 3 * x, half), 2.5, atol=1e-15)
    np.testing.assert_allclose(segment_box(x - 9 * y, x + 9 * y, half), 0.5, atol=1e-15)
    np.testing.assert_allclose(segment_box(-9 * y, 9 * y, half), 0.0, atol=1e-15)


def test_nearly_parallel_segments() -> None:
    """At every angle, however small, the distance is right to the square root of rounding."""
    for angle in 10.0 ** -np.arange(1.0, 17.0):
        a, b = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
        c = np.array([-1.0, -angle, 1e-3])
        d = np.array([1.0, angle, 1e-3])
        assert segment_segment(a, b, c, d) == pytest.approx(1e-3, abs=1e-9)


# The arm in MuJoCo -------------------------------------------------------------------------------


def shaped(seed: int, prismatic: tuple[int, ...] = ()) -> Cell:
    """A random arm of five joints with capsules, obstacles, instrument, payload and load."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, 5, prismatic)
    robot = replace(robot, efforts=np.array([400.0, np.nan, 250.0, 150.0, 100.0]))

    def capsules(count: int) -> tuple[Capsule, ...]:
        return tuple(
            Capsule(*map(tuple, rng.uniform(-0.25, 0.25, (2, 3))), rng.uniform(0.02, 0.08))
            for _ in range(count)
        )

    obstacles = [
        {
            "type": "box",
            "center_mm": tuple(rng.uniform(-600, 600, 3)),
            "size_mm": tuple(rng.uniform(200, 600, 3)),
            "rpy_deg": tuple(rng.uniform(-90, 90, 3)),
        },
        {"type": "sphere", "center_mm": tuple(rng.uniform(-500, 500, 3)), "radius_mm": 150.0},
        {"type": "halfspace", "point_mm": (0, 0, -600), "normal": (0.2, 0.1, -1)},
    ]
    carriers = {"base": 1, "j1": 1, "j3": 2, "j4": 1, "j5": 1, "tool": 2}
    return replace(
        designed(cell_of(robot, rng.uniform(-0.3, 0.3, (3, 3)), ("base",)), obstacle=obstacles),
        capsules={name: capsules(count) for name, count in carriers.items()},
        instruments=read_by(stands=np.array([3.0, 1.0, 0.5])),
        payload=Payload(4.0, (0.05, 0.0, 0.1)),
        load=Load(12.0, (0.1, 0.05, -0.02), np.radians(40.0)),
    )


def in_mujoco(cell: Cell) -> mujoco.MjModel:
    """The arm with its capsules, bounded obstacles and weights, but without the load."""
    robot = cell.robot

    def at(T: Array) -> str:
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        return f'pos="{text(T[:3, 3])}" quat="{text([w, x, y, z])}"'

    def text(values: Any) -> str:
        return " ".join(f"{v:.17g}" for v in values)

    def shapes(carrier: str) -> str:
        return "".join(
            f'<geom type="capsule" fromto="{text((*c.start, *c.end))}" size="{c.radius}"/>'
            for c in cell.capsules.get(carrier, ())
        )

    def weight(mass: float, com: Any) -> str:
        return f'<inertial pos="{text(com)}" mass="{mass}" diaginertia="1 1 1"/>'

    tool = f'<body name="tool" {at(robot.origins[-1])}>{shapes("tool")}'
    chain = tool + weight(cell.payload.mass, cell.payload.com) + "</body>"
    for k in reversed(range(robot.dof)):
        kind = "slide" if robot.prismatic[k] else "hinge"
        chain = (
            f"<body {at(robot.origins[k])}>"
            f'<joint type="{kind}" axis="{text(robot.axes[k])}"/>'
            f"{weight(robot.masses[k], robot.coms[k])}{shapes(robot.joints[k])}{chain}</body>"
        )
    box, ball, _ = cell.design.obstacles
    assert isinstance(box, Box)
    assert isinstance(ball, Ball)
    obstacles = (
        f'<geom name="box" type="box" size="{text(box.half)}" {at(box.T_base_box)}/>'
        f'<geom name="ball" type="sphere" size="{ball.radius}" '
        f'pos="{text(ball.centre)}"/>'
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{text(cell.gravity)}"/>'
        f"<worldbody>{shapes('base')}{obstacles}{chain}</worldbody></mujoco>"
    )


ARMS = [(20, ()), (23, (1,)), (24, (0, 3))]


@pytest.fixture(params=ARMS, ids=["revolute", "slides at 2", "slides at 1 and 4"], scope="module")
def arm(request: pytest.FixtureRequest) -> tuple[Cell, Scene, mujoco.MjModel]:
    cell = shaped(*request.param)
    q = np.random.default_rng(5).uniform(*cell.robot.sample_limits().T, (150, 5))
    return cell, scene_of(cell, q), in_mujoco(cell)


def configurations(scene: Scene, model: mujoco.MjModel) -> Any:
    """MuJoCo's state at each configuration."""
    data = mujoco.MjData(model)
    for row in scene.q:
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        yield data


def capsule_geoms(scene: Scene, model: mujoco.MjModel) -> list[int]:
    """Numbers of the geoms of the capsules, in the order of the scene."""
    found = [g for g in range(model.ngeom) if model.geom_type[g] == CAPSULE]
    bodies = [int(model.geom_bodyid[g]) for g in found]
    assert bodies == [c.body for c in scene.capsules]
    return found


def test_capsules_are_placed_as_in_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    _, scene, model = arm
    geoms = capsule_geoms(scene, model)
    for n, data in enumerate(configurations(scene, model)):
        for capsule, g in zip(scene.capsules, geoms, strict=True):
            radius, half, _ = model.geom_size[g]
            axis = half * data.geom_xmat[g].reshape(3, 3)[:, 2]
            ends = np.array([data.geom_xpos[g] - axis, data.geom_xpos[g] + axis])
            ours = np.array([capsule.start[n], capsule.end[n]])
            swapped = np.linalg.norm(ours - ends) > np.linalg.norm(ours[::-1] - ends)
            np.testing.assert_allclose(ours[::-1] if swapped else ours, ends, atol=1e-9)
            assert (capsule.radius, capsule.length) == pytest.approx((radius, 2 * half))


def test_names_of_capsules() -> None:
    names = [c.name for c in scene_of(shaped(1), np.zeros((2, 5))).capsules]
    assert names == ["base", "j1", "j3 #1", "j3 #2", "j4", "j5", "tool #1", "tool #2"]


def test_collisions_are_those_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, model = arm
    geoms, capsules = capsule_geoms(scene, model), scene.capsules
    constraints = {c.name: c for c in constraints_of(cell)}
    crossing = constraints["self_collision"]
    assert isinstance(crossing, SelfCollision)
    bodies = [c.body for c in capsules]
    count = len(bodies)
    could = {(i, j) for i in range(count) for j in range(count) if bodies[j] - bodies[i] > 1}
    names = {(capsules[i].name, capsules[j].name): (i, j) for i, j in could}
    exempt = {names[pair] for pair in crossing.exempt}
    assert set(crossing.pairs) | exempt == could
    obstacles = {
        "obstacle 1 (box)": model.geom("box").id,
        "obstacle 2 (sphere)": model.geom("ball").id,
    }
    gaps: dict[str, list[float]] = {name: [] for name in (*obstacles, "self_collision")}
    for data in configurations(scene, model):

        def gap(a: int, b: int, data: mujoco.MjData = data) -> float:
            return mujoco.mj_geomDistance(model, data, a, b, 10.0, None)

        for name, geom in obstacles.items():
            gaps[name].append(min(gap(g, geom) for g, b in zip(geoms, bodies, strict=True) if b))
        pairs = crossing.pairs
        gaps["self_collision"].append(min(gap(geoms[i], geoms[j]) for i, j in pairs))
    for name, found in gaps.items():
        clear = np.abs(found) > 1e-5  # MuJoCo's own accuracy where a box is concerned
        allowed = constraints[name].allows(scene)
        np.testing.assert_array_equal(allowed[clear], np.array(found)[clear] > 0.0, err_msg=name)
        assert 0 < allowed.sum() < len(allowed)


def test_sight_is_that_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    """Rays of MuJoCo from the instrument to the markers, shape by shape."""
    cell, scene, model = arm
    geoms = [*capsule_geoms(scene, model), model.geom("box").id, model.geom("ball").id]
    tip = model.body("tool").id
    expected = np.ones((len(scene), len(cell.markers)), dtype=bool)
    for n, data in enumerate(configurations(scene, model)):
        turn = data.xmat[tip].reshape(3, 3)
        for j, marker in enumerate(cell.markers @ turn.T + data.xpos[tip]):
            np.testing.assert_allclose(scene.markers[n, j], marker, atol=1e-9)
            for g in geoms:
                shape = (data.geom_xpos[g], data.geom_xmat[g], model.geom_size[g])
                kind = model.geom_type[g]
                beam = marker - cell.instrument
                met = mujoco.mju_rayGeom(*shape, cell.instrument, beam, kind, None)
                # A capsule that holds the marker does not hide it.
                x = (marker - shape[0]) @ shape[1].reshape(3, 3)
                x[2] -= np.clip(x[2], -shape[2][1], shape[2][1])
                inside = kind == CAPSULE and np.linalg.norm(x) <= shape[2][0]
                expected[n, j] &= not (0.0 <= met <= 1.0) or inside
    np.testing.assert_array_equal(visible(scene), expected)
    assert 0.05 < expected.mean() < 0.95


def test_torques_are_those_of_mujoco(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, model = arm
    assert cell.load is not None
    tip, weight = model.body("tool").id, cell.load.mass * GRAVITY
    expected = np.empty((2, len(scene), 5))
    for n, data in enumerate(configurations(scene, model)):
        expected[:, n] = -data.qfrc_bias
        hook = data.xmat[tip].reshape(3, 3) @ cell.load.com + data.xpos[tip]
        mujoco.mj_applyFT(model, data, weight, np.zeros(3), hook, tip, expected[1, n])
    np.testing.assert_allclose(static_torques(scene), expected, atol=1e-6)
    allowed = {c.name: c for c in constraints_of(cell)}["joint_torque"].allows(scene)
    over = np.abs(expected) > np.nan_to_num(cell.robot.efforts, nan=1e9)
    np.testing.assert_array_equal(allowed, ~over.any(axis=(0, 2)))
    assert 0 < allowed.sum() < len(allowed)


def test_torques_are_those_of_the_model(arm: tuple[Cell, Scene, mujoco.MjModel]) -> None:
    cell, scene, _ = arm
    assert cell.load is not None
    robot = cell.robot
    frames = forward(robot, scene.q)
    part = np.where(robot.prismatic[:, None], [[1.0, 0.0]], [[0.0, 1.0]])
    axes = np.concatenate([part[:, :1] * robot.axes, part[:, 1:] * robot.axes], axis=1)
    for reading, mass in enumerate((0.0, cell.load.mass)):
        loads = loads_of(robot, hung(poses_at(scene.q), mass, cell.load.com), cell.payload, GRAVITY)
        wrench = transmitted(loads, frames, link_origins(robot, frames, scene.q))
        expected = np.einsum("nki,ki->nk", wrench.local[:, 1:-1], axes)
        np.testing.assert_allclose(static_torques(scene)[reading], expected, atol=1e-9)


# By hand -----------------------------------------------------------------------------------------


def planar(dof: int = 3, **given: Any) -> Cell:
    """Links of one metre along x that turn about z at the origin, after each metre, and no limits."""
    lengths = np.array([0.0] + [1.0] * dof)
    robot = Robot(
        name="planar",
        base="base",
        tip="tip",
        joints=tuple(f"j{k + 1}" for k in range(dof)),
        prismatic=np.zeros(dof, dtype=bool),
        origins=transform(
            np.broadcast_to(np.eye(3), (dof + 1, 3, 3)), lengths[:, None] * np.eye(3)[0]
        ),
        axes=np.tile([0.0, 0.0, 1.0], (dof, 1)),
        limits=np.tile([-np.inf, np.inf], (dof, 1)),
        efforts=np.full(dof, np.nan),
        masses=np.zeros(dof),
        coms=np.zeros((dof, 3)),
    )
    robot = replace(robot, **{k: given.pop(k) for k in list(given) if hasattr(robot, k)})
    markers = given.pop("markers", np.array([[0.0, 0.0, 0.1]]))
    return replace(cell_of(robot, markers, ("base",)), **given)


LINK = Capsule((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
LINKS = {"j1": (LINK,), "j2": (LINK,), "j3": (LINK,)}


def only(cell: Cell) -> Constraint:
    """The one constraint of a cell."""
    (found,) = constraints_of(cell)
    return found


def allowed(cell: Cell, *degrees: tuple[float, ...]) -> list[bool]:
    return only(cell).allows(scene_of(cell, np.radians(np.array(degrees)))).tolist()


def test_cell_without_anything() -> None:
    cell = planar()
    scene = scene_of(cell, np.zeros((4, 3)))
    assert constraints_of(cell) == ()
    assert visible(scene).tolist() == [[True]] * 4
    assert not {"frames", "capsules", "markers"} & set(vars(scene)), "nothing was computed"


def test_order_and_names_of_constraints() -> None:
    cell = shaped(1)
    assert [c.name for c in constraints_of(cell)] == [
        "joint_limits",
        "obstacle 1 (box)",
        "obstacle 2 (sphere)",
        "obstacle 3 (halfspace)",
        "self_collision",
        "hanging_load",
        "joint_torque",
    ]


def test_constraints_of_a_cell_file(tmp_path: Path) -> None:
    """What a cell file says in millimetres and degrees, at three configurations of the KR 270."""
    text = embedded_text("cell.toml")
    tables = """
        [robot.capsules_mm]
        A3 = [{ from = [0, 0, 0], to = [1100, 0, 0], radius = 80 }]
        [[design.obstacle]]
        type = "box"
        center_mm = [2700, 0, 750]
        size_mm = [400, 400, 400]
        [[design.obstacle]]
        type = "halfspace"
        point_mm = [0, 0, 500]
        normal = [0, 0, -1]
        [[design.obstacle]]
        type = "sphere"
        center_mm = [0, 2000, 750]
        radius_mm = 300
        """
    text = text.replace("com_mm = [300, 0, 150]", "com_mm = [300, 0, 150]\nmax_tilt_deg = 20")
    text = text.replace("[instrument]", "[instrument]\nposition_mm = [-5000, 0, 750]")
    (tmp_path / "cell.toml").write_text(text + tables)
    (tmp_path / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    cell = load_cell(tmp_path / "cell.toml")
    # Stretched forward; to the right, A1 turns about -z; forward and raised; bent to the floor.
    q = np.radians(
        [
            [0.0, -0.01, 0, 0, 0, 0],
            [-90.0, -0.01, 0, 0, 0, 0],
            [0.0, -45.0, 0, 0, 0, 0],
            [45.0, -0.01, 30, 0, -30, 0],
        ]
    )
    scene = scene_of(cell, q)
    assert {c.name: c.allows(scene).tolist() for c in constraints_of(cell)} == {
        "joint_limits": [True, True, True, True],
        "obstacle 1 (box)": [False, True, True, True],
        "obstacle 2 (halfspace)": [True, True, True, False],
        "obstacle 3 (sphere)": [True, False, True, True],
        "hanging_load": [True, True, False, True],
    }
    # From behind, stretched forward, the box and the arm stand before all three markers.
    assert visible(scene).tolist() == [[False] * 3, [True] * 3, [True] * 3, [True] * 3]


def test_chunk_of_no_configuration() -> None:
    cell = shaped(1)
    scene = scene_of(cell, np.empty((0, 5)))
    assert all(c.allows(scene).shape == (0,) for c in constraints_of(cell))
    assert visible(scene).shape == (0, 3)


def test_scene_of_another_robot() -> None:
    with pytest.raises(CalibError, match=r"shape \(2, 4\), expected \(n, 3\)"):
        scene_of(planar(), np.zeros((2, 4)))


def test_joint_limits() -> None:
    low, high = np.radians([-90.0, -45.0, -10.0]), np.radians([90.0, 45.0, 10.0])
    cell = planar(limits=np.column_stack([low, high]))
    q = np.array([high, low, high + 1e-6 * np.eye(3)[2], low - 1e-6 * np.eye(3)[0], high + 1e-10])
    assert only(cell).allows(scene_of(cell, q)).tolist() == [True, True, False, False, True]


@pytest.mark.parametrize(
    ("obstacle", "name"),
    [
        (
            {
                "type": "box",
                "center_mm": (0, 2500, 0),
                "size_mm": (2000, 200, 200),
                "rpy_deg": (0, 0, 90),
            },
            "obstacle 1 (box)",
        ),
        ({"type": "sphere", "center_mm": (0, 2500, 0), "radius_mm": 1000}, "obstacle 1 (sphere)"),
        (
            {"type": "halfspace", "point_mm": (7, 1500, 7), "normal": (0, 3, 0)},
            "obstacle 1 (halfspace)",
        ),
    ],
)
def test_obstacles(obstacle: dict[str, Any], name: str) -> None:
    """All three begin 1.5 m from the base along y: two links reach it, less than 1.4 m does not."""
    cell = designed(planar(2, capsules={"j1": (LINK,), "j2": (LINK,)}), obstacle=[obstacle])
    assert only(replace(cell, capsules={"j2": (LINK,)})).name == name
    found = allowed(cell, (90, 0), (90, 180), (-90, 0), (90, 90), (90, 70), (90, 66))
    # One metre up and then 1 m at 20 or 24 degrees: 0.34 or 0.41 m further up, 0.1 m thick.
    sideways = obstacle["type"] == "halfspace"
    assert found == [False, True, True, True, True, not sideways]


def test_base_may_touch_obstacles() -> None:
    floor = {"type": "halfspace", "point_mm": (0, 0, -50), "normal": (0, 0, -1)}
    on_floor = designed(planar(capsules={"base": (LINK,)}), obstacle=[floor])
    assert constraints_of(on_floor) == ()
    touching = replace(on_floor, capsules={"base": (LINK,), "j1": (LINK,)})
    assert allowed(touching, (0, 0, 0)) == [False]


def test_self_collision_spares_neighbours() -> None:
    cell = planar(capsules=LINKS)
    crossing = only(cell)
    assert isinstance(crossing, SelfCollision)
    assert [crossing.pairs, crossing.exempt] == [((0, 2),), ()]
    # Links 1 and 2 on top of each other are neighbours; folded twice, links 1 and 3 meet.
    q = ((0, 0, 0), (0, 180, 0), (0, 170, 170), (0, 90, 150), (0, 90, 135), (0, 90, 90))
    assert allowed(cell, *q) == [True, False, False, False, True, True]


def test_self_collision_of_prismatic_joint() -> None:
    """A slide along z lifts the third link over the first."""
    cell = planar(
        4,
        capsules={"j1": (LINK,), "j4": (LINK,)},
        prismatic=np.array([False, False, True, False]),
        limits=np.array([[-np.pi, np.pi], [-np.pi, np.pi], [-1.0, 1.0], [-np.pi, np.pi]]),
    )
    crossing = {c.name: c for c in constraints_of(cell)}["self_collision"]
    q = np.array([[0.0, np.pi, z, np.pi] for z in (0.0, 0.19, 0.21, -0.19, -0.21)])
    assert crossing.allows(scene_of(cell, q)).tolist() == [False, False, True, False, True]


def test_pairs_that_always_overlap_are_exempt() -> None:
    """As at a spherical wrist: balls around one centre, with an arm each."""
    ball = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2)
    arm = Capsule((0.5, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
    crossing = only(
        planar(
            origins=np.tile(np.eye(4), (4, 1, 1)),
            capsules={"j1": (arm, ball), "j3": (ball, arm)},
        )
    )
    assert isinstance(crossing, SelfCollision)
    assert crossing.exempt == (("j1 #2", "j3 #1"),)
    assert crossing.pairs == ((0, 2), (0, 3), (1, 3))


@pytest.mark.parametrize("gravity", [GRAVITY, np.array([0.0, -9.0, 0.0])])
def test_hanging_load(gravity: Array) -> None:
    """Axes about z: gravity along z leaves the tip's x axis level, gravity along y does not."""
    cell = planar(load=Load(5.0, (0, 0, 0), np.radians(30.0)), gravity=gravity)
    q = ((0, 0, 0), (29.9, 0, 0), (90, -60, 0), (30.1, 0, 0), (-40, 0, 0), (150, 0, 0), (90, 90, 0))
    level = gravity[2] != 0.0
    steep = [True, True, True, level, level, True, True]
    assert allowed(cell, *q) == steep


def test_load_that_hangs_everywhere() -> None:
    cell = planar(load=Load(5.0, (0, 0, 0)), gravity=np.array([0.0, -9.0, 0.0]))
    assert constraints_of(cell) == ()
    limited = replace(cell, load=Load(5.0, (0, 0, 0), 0.1))
    assert only(limited).name == "hanging_load"
    assert constraints_of(replace(limited, gravity=np.zeros(3))) == ()
    assert constraints_of(replace(limited, load=None)) == ()


def test_joint_torque() -> None:
    """Weights in the plane: 10 kg at 3 m, and 5 kg more with the load; 30 * 9 and 45 * 9 N m."""
    heavy = {"gravity": np.array([0.0, -9.0, 0.0]), "payload": Payload(10.0, (0.0, 0.0, 0.0))}
    efforts = np.array([300.0, np.nan, np.nan])
    cell = planar(efforts=efforts, **heavy)
    assert allowed(cell, (0, 0, 0), (90, 0, 0)) == [True, True]
    loaded = replace(cell, load=Load(5.0, (0.0, 0.0, 0.0)))
    assert allowed(loaded, (0, 0, 0), (90, 0, 0), (0, 120, 0)) == [False, True, True]
    # A load on the other side of the joint relieves it, and the free reading still counts.
    weak = replace(loaded, load=Load(5.0, (-9.0, 0.0, 0.0)))
    assert allowed(weak, (0, 0, 0)) == [True]
    weak = replace(weak, robot=replace(weak.robot, efforts=np.array([200.0, np.nan, np.nan])))
    assert static_torques(scene_of(weak, np.zeros((1, 3))))[:, 0, 0] == pytest.approx([-270, 0])
    assert allowed(weak, (0, 0, 0)) == [False]


def test_torque_that_cannot_act() -> None:
    weightless = planar(efforts=np.full(3, 10.0))
    assert constraints_of(weightless) == ()
    assert constraints_of(planar(masses=np.full(3, 5.0))) == ()
    assert only(planar(masses=np.full(3, 5.0), efforts=np.full(3, 10.0))).name == "joint_torque"
    with_load = replace(weightless, load=Load(1.0, (0, 0, 0)))
    assert only(with_load).name == "joint_torque"


# Sight -------------------------------------------------------------------------------------------


def sees(cell: Cell, *degrees: tuple[float, ...]) -> list[list[bool]]:
    return visible(scene_of(cell, np.radians(np.array(degrees)))).tolist()


def test_marker_behind_a_link() -> None:
    """The instrument looks along -x: folded back, the marker hides behind the first link."""
    cell = planar(
        2,
        capsules={"j1": (LINK,)},
        instruments=read_by(stands=np.array([5.0, 0.0, 0.0])),
        markers=np.array([[-0.5, 0.0, 0.0], [-0.5, 0.0, 0.5]]),
    )
    # At 180 degrees the markers are at x = 0.5, the first inside the link, which does not hide it;
    # turned by 180 degrees and the elbow by 0 they are at x = -1.5, behind it.
    assert sees(cell, (0, 0), (0, 180), (180, 0)) == [[True, True], [True, True], [False, True]]


def test_marker_behind_the_base() -> None:
    post = Capsule((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), 0.2)
    cell = planar(
        2, capsules={"base": (post,)}, instruments=read_by(stands=np.array([5.0, 0.0, 0.0]))
    )
    assert sees(cell, (0, 0), (180, 0), (170, 0), (90, 0)) == [[True], [False], [True], [True]]


def test_marker_in_the_capsule_of_the_tool() -> None:
    """Markers on the skin of the tool and in it are seen, one behind it is not."""
    tool = Capsule((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), 0.1)
    cell = planar(
        2,
        capsules={"tool": (tool,)},
        instruments=read_by(stands=np.array([2.1, 5.0, 0.0])),
        markers=np.array([[0.1, -0.1, 0.0], [0.1, 0.0, 0.0], [0.1, -0.11, 0.0], [0.1, 0.11, 0.0]]),
    )
    assert sees(cell, (0, 0)) == [[True, True, False, True]]


def test_marker_turned_away() -> None:
    """Normals along x of the tip; an acceptance of 30 degrees, none given, and no normal."""
    cell = planar(
        2,
        instruments=read_by(stands=np.array([1e6, 0.0, 0.0])),
        markers=np.zeros((3, 3)),
    )
    cell = replace(
        cell,
        marker_normals=np.array([[1.0, 0, 0], [1.0, 0, 0], [np.nan] * 3]),
        marker_acceptance=np.array([np.radians(30.0), np.nan, np.radians(1.0)]),
    )
    assert sees(cell, (0, 0), (29.9, 0), (0, -30.1), (89.9, 0), (50, 40.1), (180, 0)) == [
        [True, True, True],
        [True, True, True],
        [False, True, True],
        [False, True, True],
        [False, False, True],
        [False, False, True],
    ]


def test_obstacles_in_the_line_of_sight() -> None:
    """A box and a ball hide what lies behind them, a half-space and what holds the instrument not."""
    box = {
        "type": "box",
        "center_mm": (3500, 0, 0),
        "size_mm": (100, 200, 800),
        "rpy_deg": (0, 0, 0),
    }
    ball = {"type": "sphere", "center_mm": (3500, 0, 0), "radius_mm": 100}
    floor = {"type": "halfspace", "point_mm": (0, 0, -100), "normal": (0, 0, -1)}
    cell = planar(2, instruments=read_by(stands=np.array([5.0, 0.0, -0.3])))
    for obstacle, hidden in ((box, True), (ball, True), (floor, False)):
        scene = designed(cell, obstacle=[obstacle])
        assert sees(scene, (0, 0), (90, 0)) == [[not hidden], [True]], obstacle["type"]
    stand = dict(box, center_mm=(5000, 0, 0))
    assert sees(designed(cell, obstacle=[stand]), (0, 0)) == [[True]]


def test_all_are_seen_without_instrument() -> None:
    cell = replace(shaped(1), instruments=read_by())
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (50, 5))
    assert visible(scene_of(cell, q)).all()
    hidden = replace(cell, instruments=read_by(stands=np.array([3.0, 1.0, 0.5])))
    assert not visible(scene_of(hidden, q)).all()


def test_answers_do_not_depend_on_the_base_axes() -> None:
    """The whole cell turned and moved about: the same configurations, the same markers."""
    cell = shaped(3)
    R, p = so3_exp(np.array([0.4, -0.8, 1.1])), np.array([0.3, -0.2, 0.5])
    T = transform(R, p)
    box, ball, space = cell.design.obstacles
    assert isinstance(box, Box)
    assert isinstance(ball, Ball)
    assert isinstance(space, HalfSpace)
    obstacles = (
        replace(box, T_base_box=T @ box.T_base_box),
        replace(ball, centre=R @ ball.centre + p),
        replace(space, point=R @ space.point + p, normal=R @ space.normal),
    )
    origins = cell.robot.origins.copy()
    origins[0] = T @ origins[0]
    (post,) = cell.capsules["base"]
    post = Capsule(
        tuple(R @ np.array(post.start) + p), tuple(R @ np.array(post.end) + p), post.radius
    )
    assert cell.instrument is not None
    other = replace(
        cell,
        robot=replace(cell.robot, origins=origins),
        design=replace(cell.design, obstacles=obstacles),
        capsules=dict(cell.capsules, base=(post,)),
        instruments=read_by(stands=R @ cell.instrument + p),
        gravity=R @ cell.gravity,
    )
    q = np.random.default_rng(6).uniform(-np.pi, np.pi, (400, 5))
    here, there = scene_of(cell, q), scene_of(other, q)
    for a, b in zip(constraints_of(cell), constraints_of(other), strict=True):
        np.testing.assert_array_equal(a.allows(here), b.allows(there), err_msg=a.name)
    np.testing.assert_array_equal(visible(here), visible(there))
