"""Commands for one hand of two, on the arm as it truly is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.arm.kinematics import forward
from calib.cell import Cell
from calib.errors import CalibError
from calib.identification import Identification
from calib.model import Model
from calib.model.build import build
from calib.poses import poses_at
from tests.calib.arm.test_trees import two_hands
from tests.helpers import all_seen


def identified() -> tuple[Cell, Model, Identification]:
    """Both arms and the torso from readings without noise: what was found is the truth."""
    cell, poses, truth = two_hands(1)
    limits = np.tile([-3.0, 3.0], (cell.robot.dof, 1))
    cell = replace(cell, robot=replace(cell.robot, limits=limits))
    model = build(cell, poses).model
    readings = model.predict(truth * model.sizes * 0.3, poses)
    return cell, model, calib.identify(cell, all_seen(poses, readings))


@pytest.mark.parametrize("tip", ["right_hand", "left_hand"])
def test_the_hand_that_is_named_comes_into_place(tip: str) -> None:
    cell, _, found = identified()
    robot = cell.robot
    targets = poses_at(np.random.default_rng(2).uniform(-1.5, 1.5, (20, robot.dof)))
    corrected = calib.compensate(cell, found, targets, tip=tip)
    frame = robot.dof + 1 + robot.tips.index(tip)
    frames = found.model.state(found.values, replace(targets, q=corrected.q)).frames
    wanted = forward(robot, targets.q)
    met = corrected.left < 1e-9
    assert met.sum() > 15
    np.testing.assert_allclose(frames.o[met, frame], wanted.o[met, frame], atol=1e-8)
    np.testing.assert_allclose(frames.R[met, frame], wanted.R[met, frame], atol=1e-8)
    beside = [j for j, moves in enumerate(robot.moving(frame)) if not moves]
    np.testing.assert_allclose(corrected.q[:, beside], targets.q[:, beside], atol=1e-14)
    assert any(note.startswith(f"commands are corrected for {tip}") for note in corrected.notes)


def test_of_several_tips_that_of_the_robot_is_meant() -> None:
    cell, _, found = identified()
    q = np.zeros((3, cell.robot.dof))
    own, right = (calib.compensate(cell, found, q, tip=tip) for tip in (None, "right_hand"))
    np.testing.assert_array_equal(own.q, right.q)
    with pytest.raises(CalibError, match="nothing is read on foot"):
        calib.compensate(cell, found, q, tip="foot")
