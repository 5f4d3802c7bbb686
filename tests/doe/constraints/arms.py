"""Arms in capsules: random ones that MuJoCo knows too, and a planar one for cases by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from calib import Cell
from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import transform
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Load
from calib.cell.planned import Ball, Box
from doe.constraints.scene import Scene
from tests.helpers import cell_of, designed, light_chain, random_robot, read_by

CAPSULE, SPHERE, BOX = (
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_BOX,
)


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
        shapes=Shapes({name: capsules(count) for name, count in carriers.items()}),
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
            for c in cell.shapes.capsules.get(carrier, ())
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


def planar(dof: int = 3, **given: Any) -> Cell:
    """Links of one metre along x that turn about z at the origin, after each metre, and no limits."""
    lengths = np.array([0.0] + [1.0] * dof)
    turns = np.broadcast_to(np.eye(3), (dof + 1, 3, 3))
    origins = transform(turns, lengths[:, None] * np.eye(3)[0])
    robot = light_chain(origins, np.tile([-np.inf, np.inf], (dof, 1)))
    robot = replace(robot, **{k: given.pop(k) for k in list(given) if hasattr(robot, k)})
    markers = given.pop("markers", np.array([[0.0, 0.0, 0.1]]))
    return replace(cell_of(robot, markers, ("base",)), **given)


LINK = Capsule((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
