"""The constraints of a cell: which there are, by which names, and the joint limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from calib import Cell, load_cell
from calib.arm.robot import Shapes
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Load
from doe.constraints import constraints_of, scene_of, visible
from doe.constraints.limits import static_torques
from doe.constraints.scene import Scene
from tests.doe.constraints.arms import LINK, allowed, configurations, only, planar, shaped
from tests.helpers import GRAVITY, designed
from tests.studies.command_line import paper_cell


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
    path = paper_cell(tmp_path)
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
    text = path.read_text().replace(
        "com_mm = [300, 0, 150]", "com_mm = [300, 0, 150]\nmax_tilt_deg = 20"
    )
    text = text.replace("[instrument]", "[instrument]\nposition_mm = [-5000, 0, 750]")
    path.write_text(text + tables)
    cell = load_cell(path)
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


def test_joint_limits() -> None:
    low, high = np.radians([-90.0, -45.0, -10.0]), np.radians([90.0, 45.0, 10.0])
    cell = planar(limits=np.column_stack([low, high]))
    q = np.array([high, low, high + 1e-6 * np.eye(3)[2], low - 1e-6 * np.eye(3)[0], high + 1e-10])
    assert only(cell).allows(scene_of(cell, q)).tolist() == [True, True, False, False, True]


# -- The arm against what stands in the cell, by hand ----------------------------------------------


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
    cell = designed(planar(2, shapes=Shapes({"j1": (LINK,), "j2": (LINK,)})), obstacle=[obstacle])
    assert only(replace(cell, shapes=Shapes({"j2": (LINK,)}))).name == name
    found = allowed(cell, (90, 0), (90, 180), (-90, 0), (90, 90), (90, 70), (90, 66))
    # One metre up and then 1 m at 20 or 24 degrees: 0.34 or 0.41 m further up, 0.1 m thick.
    sideways = obstacle["type"] == "halfspace"
    assert found == [False, True, True, True, True, not sideways]


def test_base_may_touch_obstacles() -> None:
    floor = {"type": "halfspace", "point_mm": (0, 0, -50), "normal": (0, 0, -1)}
    on_floor = designed(planar(shapes=Shapes({"base": (LINK,)})), obstacle=[floor])
    assert constraints_of(on_floor) == ()
    touching = replace(on_floor, shapes=Shapes({"base": (LINK,), "j1": (LINK,)}))
    assert allowed(touching, (0, 0, 0)) == [False]


# What the arm can do where it stands: torques against MuJoCo and the model, a load that hangs
# free -------------------------------------------------------------------------------------------


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
