"""Kinematics files as ur_description has them, beside the URDF that it makes of them.

The numbers are those of ``config/<model>/default_kinematics.yaml``, digit by digit, the frames about
them those of ``urdf/inc``: UniversalRobots/Universal_Robots_ROS2_Driver, 8be35f34 (UR5e), and
UniversalRobots/Universal_Robots_ROS2_Description, 67272756 (UR30).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib import Cell
from tests.calib.files.test_kinematics import CELL, cell_of_file, poses

ROWS = {
    "UR5e": """
shoulder 0 0 0.1625 0 0 0
upper_arm 0 0 0 1.570796327 0 0
forearm -0.425 0 0 0 0 0
wrist_1 -0.3922 0 0.1333 0 0 0
wrist_2 0 -0.0997 -2.044881182297852e-11 1.570796327 0 0
wrist_3 0 0.09959999999999999 -2.042830148012698e-11 1.570796326589793 3.141592653589793 =
hash calib_12788084448423163542""",
    "UR30": """
shoulder 0 0 0.23630000000000001 -0 0 -0
upper_arm 0 0 0 1.570796327 0 -0
forearm -0.637 0 0 -0 0 -0
wrist_1 -0.5037 0 0.20100000000000001 -0 0 -0
wrist_2 0 -0.1593 0 1.570796327 0 -0
wrist_3 0 0.15429999999999999 -3.1647459019915597e-11 1.5707963265897931 3.1415926535897931 =
hash calib_4890363623803256388""",
}  # fmt: skip
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
PI = repr(np.pi)
HALF = repr(np.pi / 2)
ENDS = 'urdf = "arm.urdf"\nbase = "base_link"\ntip = "tool0"'


def rows(model: str) -> dict[str, list[str]]:
    """By link; ``=`` repeats the number before."""
    lines = (line.split() for line in ROWS[model].strip().splitlines())
    found = {name: values for name, *values in lines}
    return {
        name: [v if v != "=" else own[k - 1] for k, v in enumerate(own)]
        for name, own in found.items()
    }


def as_yaml(model: str) -> str:
    lines = ["kinematics:"]
    for name, values in rows(model).items():
        if name == "hash":
            lines.append(f"  hash: {values[0]}")
            continue
        pairs = zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True)
        lines += [f"  {name}:", *(f"    {key}: {value}" for key, value in pairs)]
    return "\n".join([*lines, ""])


def as_urdf(model: str) -> str:
    """What xacro makes of the file: links of the chain, base and flange about them."""
    origins = [values for name, values in rows(model).items() if name != "hash"]
    links = ["base_link_inertia", *(f"{name}_link" for name in rows(model) if name != "hash")]
    parts = [f'<link name="{name}"/>' for name in ("base_link", *links, "flange", "tool0")]
    parts.append(fixed("base_link-base_link_inertia", "base_link", links[0], f"0 0 {PI}"))
    for name, own, parent, child in zip(JOINTS, origins, links[:-1], links[1:], strict=True):
        xyz, rpy = " ".join(own[:3]), " ".join(own[3:])
        parts.append(
            f'<joint name="{name}_joint" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-6.28" upper="6.28" effort="150" velocity="3"/></joint>'
        )
    parts.append(fixed("wrist_3-flange", links[-1], "flange", f"0 -{HALF} -{HALF}"))
    parts.append(fixed("flange-tool0", "flange", "tool0", f"{HALF} 0 {HALF}"))
    return f'<robot name="{model}">{"".join(parts)}</robot>'


def fixed(name: str, parent: str, child: str, rpy: str) -> str:
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0" rpy="{rpy}"/></joint>'
    )


def of_urdf(folder: Path, model: str) -> Cell:
    (folder / "arm.urdf").write_text(as_urdf(model))
    (folder / "urdf.toml").write_text(CELL.format(ends="").replace('kinematics = "arm.yaml"', ENDS))
    return calib.load_cell(folder / "urdf.toml")


@pytest.mark.parametrize("model", ROWS)
def test_the_file_is_the_arm_of_its_urdf(tmp_path: Path, model: str) -> None:
    by_file, by_urdf = cell_of_file(tmp_path, as_yaml(model)), of_urdf(tmp_path, model)
    assert by_file.robot.joints == by_urdf.robot.joints
    q = np.random.default_rng(4).uniform(-6, 6, (20, 6))
    np.testing.assert_allclose(poses(by_file.robot, q), poses(by_urdf.robot, q), rtol=0, atol=1e-9)
