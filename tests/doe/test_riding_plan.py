"""Plans for a camera on the head that watches a board in the hand, against MuJoCo and OpenCV."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from calib import load_cell
from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.cell import Cell
from doe import design
from doe.constraints import scene_of, visible
from studies.research.cameras import corners, frame, pixels
from tests.trees import in_mujoco
from tests.two_arms import EYE, PLATE, in_view, urdf, written

T_HEAD_EYE = from_xyz_rpy(np.array([0.05, 0.0, 0.06]), np.radians([-110.0, 0.0, -90.0]))
T_HAND_PLATE = from_xyz_rpy(np.array([-0.04, -0.03, -0.02]), np.zeros(3))
CAPSULE = "[[robot.capsules_mm.{}]]\nfrom = {}\nto = {}\nradius = {}\n"


def between(cell: Cell, q: Array) -> Array:
    """The plate (m, 4, 4) in the camera's axes, by MuJoCo."""
    model = in_mujoco(urdf())
    data, found = mujoco.MjData(model), []
    for row in q:
        data.qpos[[int(model.joint(name).qposadr[0]) for name in cell.robot.joints]] = row
        mujoco.mj_forward(model, data)
        ends = []
        for name, T in (("head", T_HEAD_EYE), ("right_hand", T_HAND_PLATE)):
            body = data.body(name)
            ends.append(frame(body.xpos, body.xmat.reshape(3, 3)) @ T)
        found.append(np.linalg.inv(ends[0]) @ ends[1])
    return np.array(found)


def test_every_pose_of_a_plan_shows_the_head_the_board(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, PLATE, EYE, effects='"base", "tool", "joint_offset"'))
    plan = design(cell, poses=12, candidates=1500)
    points = corners(5, 4, 0.02)
    for T in between(cell, plan.poses.q):
        uv = pixels(points, T, 900.0, (640.0, 480.0))
        assert (uv >= -0.01).all()
        assert (uv <= np.array([1280.01, 960.01])).all()
        sight = points @ T[:3, :3].T + T[:3, 3]
        lean = np.arccos(sight @ T[:3, 2] / np.linalg.norm(sight, axis=1))
        assert np.degrees(lean).max() <= 60.01
    assert "hip, bend exact and rigid, as no instrument sees them err" in plan.granted


@pytest.mark.parametrize(
    ("capsule", "hides"),
    [
        # About the eye itself, as the head's shape is.
        (CAPSULE.format("tilt", [40, 0, 60], [60, 0, 60], 60), False),
        # The chest as large as what lies between most hands and the head.
        (CAPSULE.format("bend", [150, 0, 100], [150, 0, 250], 150), True),
    ],
)
def test_what_is_between_head_and_hand_hides(tmp_path: Path, capsule: str, hides: bool) -> None:
    free = load_cell(written(tmp_path, PLATE, EYE))
    q = in_view(free, 100).q
    path = written(tmp_path, PLATE, EYE)
    path.write_text(path.read_text().replace("[boards.plate]", f"{capsule}[boards.plate]"))
    scene = scene_of(load_cell(path), q)
    assert visible(scene).all() is np.bool_(not hides)
