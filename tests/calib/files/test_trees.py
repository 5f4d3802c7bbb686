"""Robots that are trees, and cells whose markers ride on several links: read, refused, and written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import InputError
from calib.files.cell import load_cell
from calib.files.robot_out import corrected_robot
from tests.calib.arm.test_mujoco import in_mujoco
from tests.trees import as_mjcf, placed, random_tree, read, tips_of, urdf

MARKERS = """
right = [100, 20, 50]
left = { position = [80, -30, 40], on = "ON" }
"""


def cell_text(on: str, robot: str = 'urdf = "tree.urdf"', more: str = "", tip: str = "c6") -> str:
    return (
        f'schema = 1\n[robot]\n{robot}\nbase = "c0"\ntip = "{tip}"\n[markers_mm]\n'
        f"{MARKERS.replace('ON', on)}[instrument]\nsigma_mm = 0.01\n{more}"
        '[model]\neffects = ["base", "tool", "geometry"]\n'
    )


MJCF = 'mjcf = "tree.xml"'


def written(folder: Path, *args: str, seed: int = 3, **named: str) -> Path:
    joints, chain = random_tree(seed)
    (folder / "tree.urdf").write_text(urdf(joints))
    (folder / "tree.xml").write_text(as_mjcf(urdf(joints)))
    (folder / "cell.toml").write_text(cell_text(*args, tip=f"c{len(chain)}", **named))
    return folder / "cell.toml"


def other_tip(seed: int) -> str:
    joints, chain = random_tree(seed)
    return tips_of(joints, f"c{len(chain)}", seed)[0]


def stand(model: Any, data: Any, robot: Robot, q: Array) -> tuple[Array, Array]:
    """Move there; rotation and place of the base."""
    data.qpos[:] = 0.0
    data.qpos[[int(model.joint(name).qposadr[0]) for name in robot.joints]] = q
    mujoco.mj_forward(model, data)
    return data.body("c0").xmat.reshape(3, 3), data.body("c0").xpos


def test_a_marker_rides_on_the_link_that_the_cell_names(tmp_path: Path) -> None:
    joints, chain = random_tree(3)
    tip = f"c{len(chain)}"
    (other,) = tips_of(joints, tip, 3)[:1]
    cell = load_cell(written(tmp_path, other))
    assert cell.robot.tips == (other, tip)
    assert cell.marker_links == (tip, other)
    alone = read(tmp_path, joints, tip)
    own = forward(cell.robot, np.zeros((1, cell.robot.dof)))
    np.testing.assert_allclose(own.o[0, -1], forward(alone, np.zeros((1, alone.dof))).o[0, -1])
    beside = read(tmp_path, joints, other)
    there = forward(beside, np.zeros((1, beside.dof)))
    frame = cell.marker_frames[1]
    np.testing.assert_allclose(own.o[0, frame], there.o[0, -1], atol=1e-12)


@pytest.mark.parametrize(
    ("on", "named", "said"),
    [
        (
            "c99",
            {},
            "tree.urdf: has no link 'c99'; set 'on' of what it carries to one of: root, c0",
        ),
        ("root", {}, "link root: no chain of joints leads from 'c0' to it"),
        (
            "b0",
            {"robot": 'dh = "tree.csv"\ndh_convention = "classic"'},
            "tree.csv: has one tip, and 'b0' is another; write the robot as a URDF",
        ),
        (
            "c1",
            {
                "more": '[[known_distances]]\nbetween = ["right", "left"]\nmm = 50.0\n'
                "sigma_mm = 0.1\n"
            },
            "'right' and 'left' ride on c6 and c1, and are no known length apart; take it out",
        ),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    tmp_path: Path, on: str, named: dict[str, str], said: str
) -> None:
    path = written(tmp_path, on, **named)
    with pytest.raises(InputError) as error:
        load_cell(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_loads_hang_on_the_link_that_the_cell_names(tmp_path: Path) -> None:
    joints, chain = random_tree(3)
    tip = f"c{len(chain)}"
    (other,) = tips_of(joints, tip, 3)[:1]
    text = f'[payload]\nmass_kg = 2.0\ncom_mm = [0, 0, 100]\non = "{other}"\n'
    hung = text.replace("payload", "load").replace("2.0", "5.0")
    cell = load_cell(written(tmp_path, other, more=text + hung))
    assert cell.payload.frame == cell.robot.loaded == cell.robot.dof + 1
    assert load_cell(written(tmp_path, tip, more=text.replace(other, tip))).payload.frame == -1


@pytest.mark.parametrize("seed", range(8))
def test_a_corrected_tree_leads_to_the_same_markers_in_mujoco(tmp_path: Path, seed: int) -> None:
    cell: Cell = load_cell(written(tmp_path, other_tip(seed), seed=seed))
    rng = np.random.default_rng(seed)
    corrections = rng.normal(size=(cell.robot.frame_count, 6)) * 1e-2
    corrections[0] = 0.0
    markers = dict(zip(cell.marker_names, cell.markers, strict=True))
    model: Any = in_mujoco(corrected_robot(cell, corrections, markers, tmp_path / "out.urdf").text)
    data: Any = mujoco.MjData(model)
    q = rng.uniform(-1.0, 1.0, (4, cell.robot.dof))
    frames = forward(cell.robot, q, corrections)
    for i, row in enumerate(q):
        R, p = stand(model, data, cell.robot, row)
        for name, frame in zip(cell.marker_names, cell.marker_frames, strict=True):
            ours = frames.o[i, frame] + frames.R[i, frame] @ markers[name]
            np.testing.assert_allclose(R @ ours + p, data.body(f"marker_{name}").xpos, atol=1e-9)


def test_a_tree_of_another_form_is_refused(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, other_tip(3), MJCF))
    with pytest.raises(InputError, match=r"one tip, and this robot has .*; name the robot's URDF"):
        corrected_robot(cell, np.zeros((cell.robot.frame_count, 6)), {}, tmp_path / "out.urdf")


@pytest.mark.parametrize("seed", range(4))
def test_shapes_beside_the_chain_go_with_the_link_that_carries_them(
    tmp_path: Path, seed: int
) -> None:
    """All beside the chain, and beyond its tip, is held at zero."""
    joints, chain = random_tree(seed)
    tip = f"c{len(chain)}"
    robot = read(tmp_path, joints, tip)
    T = placed(joints, {})
    owner: dict[str, str] = {"c0": "base"}
    for joint in joints:
        if joint.parent in owner:
            own = joint.name if joint.name in robot.joints else owner[joint.parent]
            owner[joint.child] = own
    carrier = {"base": "c0"} | {j.name: j.child for j in joints}
    for name, capsules in robot.shapes.capsules.items():
        links = [j for j in joints if owner.get(j.child) == name]
        frame = np.linalg.inv(T[carrier[name]])
        expected = sorted(tuple((frame @ T[j.child] @ [*j.com, 1.0])[:3]) for j in links)
        np.testing.assert_allclose(sorted(c.start for c in capsules), expected, atol=1e-9)
