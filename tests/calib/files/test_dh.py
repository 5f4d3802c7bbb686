"""DH tables in and out, against forward kinematics in plain numpy and against MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, cast

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell
from calib.arm.kinematics import forward
from calib.arm.se3 import displacement, so3_exp
from calib.arrays import Array
from calib.files.dh_out import corrected_dh
from calib.files.robot_out import corrected_robot
from studies.demo.embedded import embedded_cell
from tests.helpers import cell_text
from tests.plain_arm import dh_pose, rows_of

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
Convention = Literal["classic", "modified"]


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
    """Through the MJCF that is written from it: another program's joints."""
    table = TABLES["a SCARA in other units"]
    cell = cell_of_table(tmp_path, table, convention)
    tool = {"m": np.array([0.05, 0.02, -0.1])}
    made = corrected_robot(cell, "mjcf", np.zeros((6, 6)), tool, tmp_path / "x.xml")
    model = mujoco.MjModel.from_xml_string(made.text)
    data = mujoco.MjData(model)
    for own in readings(cell):
        data.qpos[:] = own
        mujoco.mj_kinematics(model, data)
        expected = dh_pose(table, convention, own) @ [*tool["m"], 1.0]
        np.testing.assert_allclose(data.site("marker_m").xpos, expected[:3], atol=1e-12)
    assert "made anew from the DH table" in made.lacks[0]


@pytest.mark.parametrize("convention", BOTH)
@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
def test_a_table_comes_back_as_it_was(tmp_path: Path, table: str, convention: str) -> None:
    cell = cell_of_table(tmp_path, table, convention)
    nothing = np.zeros((cell.robot.dof + 2, 6))
    made = corrected_robot(cell, "dh", nothing, {"m1": cell.markers[0]}, tmp_path / "out.csv")
    for own, was in zip(rows_of(made.text), rows_of(table), strict=True):
        assert (own["joint"], own["kind"]) == (was["joint"], was["kind"])
        for key in ("alpha", "a", "theta", "d", "beta"):
            assert own[key] == pytest.approx(was[key], abs=1e-12), (was["joint"], key)
    assert set(made.text.split("\n")[0].split(",")) <= {*table.split("\n")[0].split(",")}
    assert not [lack for lack in made.lacks if "frame" in lack]


def displaced_pose(cell: Cell, corrections: Array, q: Array) -> Array:
    """T_base_tip with every frame displaced, joint by joint."""
    T = np.eye(4)
    for k in range(cell.robot.dof + 1):
        T = T @ cell.robot.origins[k] @ displacement(corrections[k + 1])
        if k < cell.robot.dof:
            motion = np.eye(4)
            if cell.robot.prismatic[k]:
                motion[:3, 3] = cell.robot.axes[k] * q[k]
            else:
                motion[:3, :3] = so3_exp(cell.robot.axes[k] * q[k])
            T = T @ motion
    return T


@pytest.mark.parametrize("convention", BOTH)
@pytest.mark.parametrize("name", [*TABLES, "a URDF"])
def test_what_was_identified_is_in_the_table(tmp_path: Path, name: str, convention: str) -> None:
    """Table, both end frames and beta are the corrected arm, to rounding; every number is near."""
    tables = TABLES | {"a URDF": TABLES["a gantry"]}
    cell = cell_of_table(tmp_path, tables[name], convention)
    cell = embedded_cell() if name == "a URDF" else cell
    corrections = 1e-3 * np.random.default_rng(1).normal(size=(cell.robot.dof + 2, 6))
    fit, text = corrected_dh(cell, corrections, cast("Convention", convention))
    for q in readings(cell):
        T = fit.T_base @ dh_pose(text, convention, q) @ fit.T_tip
        np.testing.assert_allclose(T, displaced_pose(cell, corrections, q), atol=1e-12)
    for own in rows_of(text):
        assert abs(own["d"]) < 2.0, "no foot of a common normal far away"  # type: ignore[arg-type]
        assert abs(own["beta"]) < 0.01  # type: ignore[arg-type]


def test_what_a_table_cannot_hold_is_said_with_its_size(tmp_path: Path) -> None:
    table = TABLES["three parallel axes"]
    cell = cell_of_table(tmp_path, table, "classic")
    corrections = np.zeros((8, 6))
    corrections[3, 3] = 0.5e-3  # of the elbow, across its axis and along the link: alpha
    plain = corrected_robot(cell, "dh", corrections, {}, tmp_path / "out.csv")
    assert "beta" not in "".join(plain.lacks) + plain.text
    corrections[3, 4] = 1e-3  # across the link: no number of a table
    corrections[7, 0] = 2e-3  # of the tip
    tool = {"m1": np.array([0.08, 0.0, 0.04])}
    made = corrected_robot(cell, "dh", corrections, tool, tmp_path / "out.csv")
    (said,) = [lack for lack in made.lacks if lack.startswith("beta (Hayati) at lift")]
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 6))
    without = "\n".join(line.rpartition(",")[0] for line in made.text.strip().split("\n"))
    point = np.array([0.08, 0.0, 0.04, 1.0])
    off = [(dh_pose(made.text, "classic", p) - dh_pose(without, "classic", p)) @ point for p in q]
    worst = np.linalg.norm(off, axis=1).max() * 1e3
    size = float(said.split("up to ")[1].split(" mm")[0])
    assert 0.8 * worst < size < 1.05 * worst, "seen over a few poses only"
    (again := tmp_path / "again").mkdir()
    reread = cell_of_table(again, made.text, "classic")
    assert corrected_robot(reread, "dh", np.zeros((8, 6)), {}, again / "x.csv").text == made.text


def test_a_urdf_as_table_says_what_is_lost(tmp_path: Path) -> None:
    cell = embedded_cell()
    made = corrected_robot(
        cell, "dh", np.zeros((8, 6)), {"m1": cell.markers[0]}, tmp_path / "o.csv"
    )
    said = "\n".join(made.lacks)
    assert "made anew from the URDF: without limits, efforts, masses and shapes" in said
    assert "tool0 stands in its last frame" in said
    assert "m1 is at" in said
