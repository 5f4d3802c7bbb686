"""The calibration of a UR controller, against frames composed in plain numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.arm.dh import robot_of_dh
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.files.ur_calibration import MODELS, nominal_ur, read_ur_calibration
from tests.plain_arm import dh_pose, rpy_pose

PI = np.pi
UR = {  # a UR5e by its published lengths
    "shoulder": [0, 0, 0.1625, 0, 0, 0],
    "upper_arm": [0, 0, 0, PI / 2, 0, 0],
    "forearm": [-0.425, 0, 0, 0, 0, 0],
    "wrist_1": [-0.3922, 0, 0.1333, 0, 0, 0],
    "wrist_2": [0, -0.0997, 0, PI / 2, 0, 0],
    "wrist_3": [0, 0.0996, 0, PI / 2, PI, PI],
}
Q = np.random.default_rng(2).uniform(-3, 3, (5, 6))


def poses(robot: Robot, q: Array) -> Array:
    """T_base_tip, shape (m, 4, 4)."""
    frames = forward(robot, q)
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = frames.R[:, -1], frames.o[:, -1]
    return T


def ur_table(model: str, delta: dict[str, list[float]]) -> str:
    """Nominal plus differences, as the maker says a controller reads its file."""
    (a2, a3), (d1, d4, d5, d6) = MODELS[model]
    nominal = {
        "alpha": [PI / 2, 0, 0, PI / 2, -PI / 2, 0],
        "a": [0, a2, a3, 0, 0, 0],
        "theta": [0] * 6,
        "d": [d1, 0, 0, d4, d5, d6],
    }
    sums = {key: [n + x for n, x in zip(nominal[key], delta[key], strict=True)] for key in nominal}
    rows = [
        f"j{k},{sums['alpha'][k]!r},{sums['a'][k]!r},{sums['theta'][k]!r},{sums['d'][k]!r}"
        for k in range(6)
    ]
    return "\n".join(["joint,alpha_rad,a_m,theta_rad,d_m", *rows, ""])


def test_a_controllers_file_whose_normals_run_far_away(tmp_path: Path) -> None:
    """d of 439 m and -446 m: the same arm with every number where the nominal table has it."""
    delta = {
        "theta": [2e-5, 0.31, -0.42, 0.11, -3e-5, 1e-5],
        "a": [1e-4, 0.0006, -0.0004, 5e-5, -6e-5, 0.0],
        "d": [2e-4, 439.1, -446.4, 7.3002, -1e-4, 3e-4],
        "alpha": [1e-4, 2.1e-4, -1.7e-4, 2e-4, -1e-4, 0.0],
    }
    lines = ["[mounting]", "# of this arm"]
    lines += [f"delta_{key} = {values}" for key, values in delta.items()]
    lines += ["joint_checksum = [0x1, 0x2]", "[other]", "x = 1", ""]
    (tmp_path / "calibration.conf").write_text("\n".join(lines))
    table = read_ur_calibration(tmp_path / "calibration.conf", "ur5e")
    robot = robot_of_dh(table, "UR5e", "base", "tool0")
    exact = ur_table("UR5e", delta)
    for q in Q:
        T = dh_pose(exact, "classic", q)
        np.testing.assert_allclose(poses(robot, q[None])[0], T, atol=1e-9)
    assert np.abs(table.d).max() < 0.2
    assert 1e-5 < np.abs(table.beta[1:3]).max() < 1e-3


@pytest.mark.parametrize("model", MODELS)
def test_published_tables_are_the_arms_of_ros(model: str) -> None:
    """A UR's DH frames are those that ROS has in base_link_inertia."""
    (a2, a3), (d1, d4, d5, d6) = MODELS[model]
    origins = {name: list(own) for name, own in UR.items()}
    origins["shoulder"][2], origins["forearm"][0] = d1, a2
    origins["wrist_1"][0], origins["wrist_1"][2] = a3, d4
    origins["wrist_2"][1], origins["wrist_3"][1] = -d5, d6
    table = robot_of_dh(nominal_ur(model), model, "base", "tool0")
    for q in Q:
        T = rpy_pose(list(origins.values()), q)
        np.testing.assert_allclose(poses(table, q[None])[0], T, atol=1e-12)
