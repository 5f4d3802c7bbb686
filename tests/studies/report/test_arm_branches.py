"""The picture of a robot with several tips: every way, and what rides where."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import calib
from calib.arm.kinematics import forward
from calib.arm.se3 import so3_exp
from calib.files.cell import load_cell
from calib.model.build import build
from calib.poses import poses_at
from studies.report.arm_scene import scene
from studies.report.arm_view import drawing
from tests.two_arms import EYE, PLATE, in_view, written

MARKERS = {"m": [0, 50, 10], "n": [40, 0, 10], "k": [0, -40, 10]}
LEFT = '[markers_mm]\nm = { position = [0, 50, 10], on = "left_hand" }\n'


def test_each_way_ends_at_its_tip_and_begins_on_another(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, LEFT, PLATE, EYE))
    poses, robot = in_view(cell, 5), cell.robot
    shown, frames = scene(cell, poses), forward(robot, poses.q)
    assert set(shown.branches) == {"left_hand", "head"}
    drawn = {tuple(point) for point in shown.chain[0].tolist()}
    for link, way in shown.branches.items():
        frame = robot.dof + 1 + robot.tips.index(link)
        np.testing.assert_allclose(way[:, -1], frames.o[:, frame] * 1e3, atol=0.51)
        assert tuple(way[0, 0].tolist()) in drawn
    np.testing.assert_allclose(shown.stems[:, 0], shown.branches["left_hand"][:, -1], atol=0.51)
    assert ">left_hand</text>" in str(drawing(shown, "k"))


def test_the_camera_is_on_the_head_and_the_board_in_the_hand(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, PLATE, EYE))
    poses = in_view(cell, 5)
    shown, frames = scene(cell, poses), forward(cell.robot, poses.q)
    eye, plate = shown.fixtures
    head = cell.robot.dof + 1
    at = frames.R[:, head] @ [0.05, 0.0, 0.06] + frames.o[:, head]
    np.testing.assert_allclose(eye.label[:, 0], at, atol=0.51e-3)
    assert eye.stem is not None
    assert plate.stem is not None
    np.testing.assert_allclose(plate.stem[:, 0], frames.o[:, -1], atol=0.51e-3)
    sight = (plate.label - eye.label)[:, 0]
    forth = (eye.lines[0].mean(axis=1) - eye.label[:, 0]).astype(float)
    cosine = (sight * forth).sum(1) / np.linalg.norm(sight, axis=1) / np.linalg.norm(forth, axis=1)
    assert cosine.min() > 0.7


def test_an_instrument_that_rides_is_drawn_where_it_is_found(tmp_path: Path) -> None:
    """What a tracker on one hand reads of the other is no point in the base's axes."""
    reader = '[instruments.probe]\nkind = "points"\non = "right_hand"\nsigma_mm = 0.01\n'
    three = "".join(f"{n} = {{ position = {p}, on = 'left_hand' }}\n" for n, p in MARKERS.items())
    cell = load_cell(written(tmp_path, f"[markers_mm]\n{three}", reader))
    poses = poses_at(np.random.default_rng(0).uniform(-1.0, 1.0, (30, cell.robot.dof)))
    model = build(cell, poses).model
    values = model.initial.copy()
    values[:6] = [0.1, -0.2, 0.3, 0.2, -0.1, 0.4]
    shown = scene(cell, calib.simulate(cell, poses, values, rng=1))
    (probe,) = shown.fixtures
    R = so3_exp(values[3:6])
    frames, tip = forward(cell.robot, poses.q), cell.robot.tip_frame
    at = frames.R[:, tip] @ (-R.T @ values[:3]) + frames.o[:, tip]
    np.testing.assert_allclose(probe.label[:, 0], at, atol=0.6e-3)
