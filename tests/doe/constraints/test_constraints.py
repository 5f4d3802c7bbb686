"""The constraints of a cell: which there are, by which names, and the joint limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib import load_cell
from doe.constraints import constraints_of, scene_of, visible
from studies.demo.embedded import embedded_text
from tests.doe.constraints.arms import only, planar, shaped


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


def test_joint_limits() -> None:
    low, high = np.radians([-90.0, -45.0, -10.0]), np.radians([90.0, 45.0, 10.0])
    cell = planar(limits=np.column_stack([low, high]))
    q = np.array([high, low, high + 1e-6 * np.eye(3)[2], low - 1e-6 * np.eye(3)[0], high + 1e-10])
    assert only(cell).allows(scene_of(cell, q)).tolist() == [True, True, False, False, True]
