"""DH tables, against forward kinematics in plain numpy and against MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell
from calib.arm.kinematics import forward
from calib.arrays import Array
from calib.files.robot_out import corrected_robot
from tests.calib.arm.test_mujoco import in_mujoco
from tests.helpers import cell_text
from tests.plain_arm import dh_pose

CELL = cell_text(
    'dh = "arm.csv"\ndh_convention = "{convention}"', "m1 = [80, 0, 40]\nm2 = [-40, 70, 40]"
)
TABLES = {
    "three parallel axes": """joint,alpha_deg,a_mm,theta_deg,d_mm
pan,90,0,0,162.5
lift,0,-425,0,0
elbow,0,-392.2,0,0
w1,90,0,0,133.3
w2,-90,0,0,99.7
w3,0,0,0,99.6
""",
    "stretched, alpha turned by 180": """joint,alpha_deg,a_mm,theta_deg,d_mm
A1,180,0,0,-645
A2,90,330,0,0
A3,0,1150,-90,0
A4,90,115,0,-1220
A5,-90,0,0,0
A6,90,0,180,-240
""",
    "a SCARA in other units": """joint,kind,d_m,theta_rad,a_mm,alpha_rad
J1,revolute,0.3,0.1,325,0
J2,revolute,0.05,-0.2,275,3.141592653589793
J3,prismatic,0.02,0,0,0
J4,revolute,0.01,0.3,0,0
""",
    "a gantry": """joint,kind,alpha_deg,a_m,theta_deg,d_mm,beta_deg
X,prismatic,-90,0.01,-90,12.5,0
Y,prismatic,90,0.02,90,0,0
B,revolute,0,0.1,0,50,0.03
C,revolute,30,0.2,45,10,0
""",
}
BOTH = ("classic", "modified")


def cell_of_table(folder: Path, table: str, convention: str) -> Cell:
    (folder / "arm.csv").write_text(table)
    (folder / "cell.toml").write_text(CELL.format(convention=convention))
    return calib.load_cell(folder / "cell.toml")


def readings(cell: Cell, count: int = 6) -> Array:
    rng = np.random.default_rng(4)
    return rng.uniform(-1, 1, (count, cell.robot.dof)) * np.where(cell.robot.prismatic, 0.4, 3.0)


@pytest.mark.parametrize("convention", BOTH)
@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
def test_the_chain_is_that_of_the_table(tmp_path: Path, table: str, convention: str) -> None:
    cell = cell_of_table(tmp_path, table, convention)
    q = readings(cell)
    frames = forward(cell.robot, q)
    for i, own in enumerate(q):
        T = dh_pose(table, convention, own)
        np.testing.assert_allclose(frames.R[i, -1], T[:3, :3], atol=1e-14)
        np.testing.assert_allclose(frames.o[i, -1], T[:3, 3], atol=1e-14)
    assert (cell.robot.base, cell.robot.tip) == ("base", "tip")
    assert str(cell.robot.source) == "DH table"


@pytest.mark.parametrize("convention", BOTH)
def test_mujoco_moves_the_table_likewise(tmp_path: Path, convention: str) -> None:
    """Through the URDF that is written from it: another program's joints."""
    table = TABLES["a SCARA in other units"]
    cell = cell_of_table(tmp_path, table, convention)
    tool = {"m": np.array([0.05, 0.02, -0.1])}
    made = corrected_robot(cell, np.zeros((6, 6)), tool, tmp_path / "x.urdf")
    model: Any = in_mujoco(made.text)
    data: Any = mujoco.MjData(model)
    for own in readings(cell):
        data.qpos[:] = own
        mujoco.mj_kinematics(model, data)
        expected = dh_pose(table, convention, own) @ [*tool["m"], 1.0]
        np.testing.assert_allclose(data.body("marker_m").xpos, expected[:3], atol=1e-12)
    assert "made anew from the DH table" in made.lacks[0]
