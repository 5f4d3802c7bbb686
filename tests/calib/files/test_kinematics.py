"""Files of robot makers in and out, against frames composed in plain numpy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell
from calib.arm.dh import robot_of_dh
from calib.arm.kinematics import forward
from calib.arm.robot import Robot, Source
from calib.arrays import Array
from calib.errors import InputError
from calib.files.kinematics import MODELS, nominal_ur, read_ur_calibration
from calib.files.robot_out import corrected_robot
from calib.files.urdf import load_urdf
from calib.files.yaml_text import read_yaml
from tests.helpers import cell_text
from tests.plain_arm import dh_pose, rpy_pose, turn

CELL = cell_text('kinematics = "arm.yaml"\n{ends}', "m1 = [80, 0, 40]")
PI = np.pi
UR = {  # a UR5e by its published lengths
    "shoulder": [0, 0, 0.1625, 0, 0, 0],
    "upper_arm": [0, 0, 0, PI / 2, 0, 0],
    "forearm": [-0.425, 0, 0, 0, 0, 0],
    "wrist_1": [-0.3922, 0, 0.1333, 0, 0, 0],
    "wrist_2": [0, -0.0997, 0, PI / 2, 0, 0],
    "wrist_3": [0, 0.0996, 0, PI / 2, PI, PI],
}
FRANKA = {
    "joint1": [0, 0, 0.333, 0, 0, 0],
    "joint2": [0, 0, 0, -PI / 2, 0, 0],
    "joint3": [0, -0.316, 0, PI / 2, 0, 0],
    "joint4": [0.0825, 0, 0, PI / 2, 0, 0],
    "joint5": [-0.0825, 0.384, 0, -PI / 2, 0, 0],
    "joint6": [0, 0, 0, PI / 2, 0, 0],
    "joint7": [0.088, 0, 0, PI / 2, 0, 0],
    "joint8": [0, 0, 0.107, 0, 0, 0],
}
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


def ur_text(origins: dict[str, list[float]] = UR) -> str:
    """As a driver writes it for one arm, and as people edit it: a comment, a map in one line."""
    lines = ["# arm 7 of hall 3", "kinematics:"]
    for name, own in origins.items():
        pairs = [f"{key}: {value!r}" for key, value in zip(KEYS, own, strict=True)]
        if name == "forearm":
            lines.append(f"  {name}: {{{', '.join(pairs)}}}  # measured")
        else:
            lines += [f"  {name}:", *(f"    {pair}" for pair in pairs)]
    return "\n".join([*lines, "  hash: calib_12345", ""])


def franka_text(origins: dict[str, list[float]] = FRANKA) -> str:
    lines = []
    for name, own in origins.items():
        lines += [f"{name}:", "  kinematic:"]
        lines += [f"    {key}: {value!r}" for key, value in zip(KEYS, own, strict=True)]
    return "\n".join([*lines, ""])


def cell_of_file(folder: Path, text: str, ends: str = "") -> Cell:
    (folder / "arm.yaml").write_text(text)
    (folder / "cell.toml").write_text(CELL.format(ends=ends))
    return calib.load_cell(folder / "cell.toml")


def poses(robot: Robot, q: Array) -> Array:
    """T_base_tip, shape (m, 4, 4)."""
    frames = forward(robot, q)
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = frames.R[:, -1], frames.o[:, -1]
    return T


def numbers(path: Path) -> dict[str, list[float]]:
    """x .. yaw of every joint of a UR file."""
    found = read_yaml(path).root["kinematics"]
    assert isinstance(found, dict)
    return {
        name: [float(own[key].word) for key in KEYS]  # type: ignore[union-attr]
        for name, own in found.items()
        if isinstance(own, dict)
    }


Q = np.random.default_rng(2).uniform(-3, 3, (5, 7))


def test_universal_robots_with_their_base_turned(tmp_path: Path) -> None:
    cell = cell_of_file(tmp_path, ur_text())
    assert cell.robot.joints[0] == "shoulder_pan_joint"
    assert (cell.robot.base, cell.robot.tip) == ("base_link", "tool0")
    inertia = cell_of_file(tmp_path, ur_text(), 'base = "base_link_inertia"')
    for q in Q[:, :6]:
        T = rpy_pose(list(UR.values()), q)
        np.testing.assert_allclose(poses(inertia.robot, q[None])[0], T, atol=1e-12)
        np.testing.assert_allclose(poses(cell.robot, q[None])[0], turn("z", PI) @ T, atol=1e-12)


def test_franka_with_its_flange(tmp_path: Path) -> None:
    cell = cell_of_file(tmp_path, franka_text())
    assert cell.robot.joints == tuple(f"joint{k}" for k in range(1, 8))
    for q in Q:
        T = rpy_pose(list(FRANKA.values()), q)
        np.testing.assert_allclose(poses(cell.robot, q[None])[0], T, atol=1e-12)


@pytest.mark.parametrize("text", [ur_text(), franka_text()], ids=["UR", "Franka"])
def test_a_file_comes_back_letter_by_letter(tmp_path: Path, text: str) -> None:
    cell = cell_of_file(tmp_path, text)
    nothing = np.zeros((cell.robot.dof + 2, 6))
    made = corrected_robot(cell, "kinematics", nothing, {}, tmp_path / "o.yaml")
    assert made.text == text
    assert made.lacks == ()


def test_corrections_go_into_the_users_own_file(tmp_path: Path) -> None:
    """Comments and hash stay; the numbers are those of the corrected arm."""
    cell = cell_of_file(tmp_path, ur_text())
    corrections = np.zeros((8, 6))
    corrections[3] = [1e-3, -2e-3, 3e-4, 1e-3, 2e-3, -5e-4]
    corrections[7, 2] = 1e-3
    made = corrected_robot(cell, "kinematics", corrections, {}, tmp_path / "o.yaml")
    assert "# arm 7 of hall 3" in made.text
    assert "# measured" in made.text
    assert "hash: calib_12345" in made.text
    assert made.lacks == ("has no place for tool0: its displacement is left out",)
    (tmp_path / "o.yaml").write_text(made.text)
    found = numbers(tmp_path / "o.yaml")
    assert [found[name] for name in UR if name != "forearm"] == [
        own for name, own in UR.items() if name != "forearm"
    ]
    np.testing.assert_allclose(found["forearm"][:3], [-0.424, -0.002, 0.0003], atol=1e-15)
    roll, pitch, yaw = found["forearm"][3:]
    R = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
    vector = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    np.testing.assert_allclose(vector, [1e-3, 2e-3, -5e-4], atol=1e-8)


@pytest.mark.parametrize("text", [ur_text(), franka_text()], ids=["UR", "Franka"])
def test_from_a_urdf_of_the_same_arm(tmp_path: Path, text: str) -> None:
    """The file that a URDF gives places the same tip; what only the maker's file has is said."""
    cell = cell_of_file(tmp_path, text)
    corrections = np.zeros((cell.robot.dof + 2, 6))
    corrections[1:-1] = 1e-3 * np.random.default_rng(0).normal(size=(cell.robot.dof, 6))
    whole = corrected_robot(cell, "urdf", corrections, {}, tmp_path / "arm.urdf")
    (tmp_path / "arm.urdf").write_text(whole.text)
    ends = f'urdf = "arm.urdf"\nbase = "{cell.robot.base}"\ntip = "{cell.robot.tip}"'
    toml = CELL.format(ends="").replace('kinematics = "arm.yaml"', ends)
    (tmp_path / "from_urdf.toml").write_text(toml)
    other = calib.load_cell(tmp_path / "from_urdf.toml")
    made = corrected_robot(other, "kinematics", 0.0 * corrections, {}, tmp_path / "o.yaml")
    (again := tmp_path / "again").mkdir()
    q = Q[:, : cell.robot.dof]
    read = cell_of_file(again, made.text)
    np.testing.assert_allclose(poses(read.robot, q), poses(other.robot, q), atol=1e-12)
    assert ("has no hash" in " ".join(made.lacks)) is ("kinematics:" in text)


def test_other_arms_have_no_such_file(tmp_path: Path) -> None:
    robot = robot_of_dh(nominal_ur("UR5e"), "arm", "base", "tip")
    cell = cell_of_file(tmp_path, ur_text())
    renamed = Robot(**{**robot.__dict__, "joints": tuple("abcdef")})
    cell = replace(cell, robot=replace(renamed, source=Source("urdf")))
    with pytest.raises(InputError, match="neither those of Universal Robots"):
        corrected_robot(cell, "kinematics", np.zeros((8, 6)), {}, tmp_path / "o.yaml")


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
    for q in Q[:, :6]:
        T = dh_pose(exact, "classic", q)
        np.testing.assert_allclose(poses(robot, q[None])[0], T, atol=1e-9)
    assert np.abs(table.d).max() < 0.2
    assert 1e-5 < np.abs(table.beta[1:3]).max() < 1e-3


@pytest.mark.parametrize("model", MODELS)
def test_published_tables_and_ros_files_are_one_arm(tmp_path: Path, model: str) -> None:
    """A UR's DH frames are those of its kinematics file, in base_link_inertia."""
    (a2, a3), (d1, d4, d5, d6) = MODELS[model]
    origins = {name: list(own) for name, own in UR.items()}
    origins["shoulder"][2], origins["forearm"][0] = d1, a2
    origins["wrist_1"][0], origins["wrist_1"][2] = a3, d4
    origins["wrist_2"][1], origins["wrist_3"][1] = -d5, d6
    own = cell_of_file(tmp_path, ur_text(origins), 'base = "base_link_inertia"')
    table = robot_of_dh(nominal_ur(model), model, "base", "tool0")
    q = Q[:, :6]
    np.testing.assert_allclose(poses(own.robot, q), poses(table, q), atol=1e-12)


# ``config/ur30/default_kinematics.yaml``, digit by digit, of
# UniversalRobots/Universal_Robots_ROS2_Description, 67272756.
UR30 = {
    "shoulder": "0 0 0.23630000000000001 -0 0 -0",
    "upper_arm": "0 0 0 1.570796327 0 -0",
    "forearm": "-0.637 0 0 -0 0 -0",
    "wrist_1": "-0.5037 0 0.20100000000000001 -0 0 -0",
    "wrist_2": "0 -0.1593 0 1.570796327 0 -0",
    "wrist_3": "0 0.15429999999999999 -3.1647459019915597e-11 "
    "1.5707963265897931 3.1415926535897931 3.1415926535897931",
}


def test_the_file_is_the_arm_of_the_urdf_that_xacro_makes_of_it(tmp_path: Path) -> None:
    """Base and flange stand about the chain as in ``urdf/inc`` of the same package."""
    half = PI / 2
    fixed, turning = "fixed", "revolute"
    rows = [("base", fixed, f"0 0 0 0 0 {PI}")]
    rows += [(name, turning, own) for name, own in UR30.items()]
    rows += [
        ("flange", fixed, f"0 0 0 0 {-half} {-half}"),
        ("tool0", fixed, f"0 0 0 {half} 0 {half}"),
    ]
    text, parent = '<robot name="UR30"><link name="base_link"/>', "base_link"
    for name, kind, numbers in rows:
        xyz, rpy = " ".join(numbers.split()[:3]), " ".join(numbers.split()[3:])
        text += (
            f'<link name="{name}"/><joint name="j_{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-6" upper="6" effort="9" velocity="3"/></joint>'
        )
        parent = name
    (tmp_path / "arm.urdf").write_text(f"{text}</robot>")
    of_urdf = load_urdf(tmp_path / "arm.urdf", "base_link", "tool0")
    origins = {name: [float(v) for v in own.split()] for name, own in UR30.items()}
    of_file = cell_of_file(tmp_path, ur_text(origins)).robot
    q = np.random.default_rng(4).uniform(-6, 6, (20, 6))
    np.testing.assert_allclose(poses(of_file, q), poses(of_urdf, q), rtol=0, atol=1e-9)
