"""The robot of two arms that is made of the two public chains is both of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.kinematics import forward
from studies.research.justin import SIDES, alone, justin


def test_each_hand_is_where_its_own_chain_has_it(data: Path) -> None:
    cell, both = justin()
    robot, q = cell.robot, both.poses.q
    frames = forward(robot, q)
    assert robot.undriven == {"t4"}
    for side in SIDES:
        own, read = alone(side)
        joints = [robot.joints.index(j if j[0] == "t" else f"{side}_{j}") for j in own.robot.joints]
        np.testing.assert_allclose(q[:, joints], read.poses.q, atol=1e-8)
        hand = cell.marker_names.index(side)
        tip = cell.marker_frames[hand]
        expected = forward(own.robot, read.poses.q)
        np.testing.assert_allclose(frames.o[:, tip], expected.o[:, -1], atol=1e-8)
        np.testing.assert_allclose(frames.R[:, tip], expected.R[:, -1], atol=1e-8)
        np.testing.assert_array_equal(both.points[:, hand], read.points[:, 0])
