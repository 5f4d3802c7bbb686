"""Cells whose markers ride on several links: read, refused in one line, and written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import forward
from calib.errors import InputError
from calib.files.cell import load_cell
from calib.files.robot_out import corrected_robot
from tests.calib.arm.test_mujoco import body_positions, in_mujoco
from tests.trees import random_tree, read, tips_of, urdf

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


def written(folder: Path, *args: str, **named: str) -> Path:
    joints, chain = random_tree(3)
    (folder / "tree.urdf").write_text(urdf(joints))
    (folder / "cell.toml").write_text(cell_text(*args, tip=f"c{len(chain)}", **named))
    return folder / "cell.toml"


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
    joints, chain = random_tree(seed)
    tip = f"c{len(chain)}"
    (other,) = tips_of(joints, tip, seed)[:1]
    (tmp_path / "tree.urdf").write_text(urdf(joints))
    (tmp_path / "cell.toml").write_text(cell_text(other, tip=tip))
    cell = load_cell(tmp_path / "cell.toml")
    rng = np.random.default_rng(seed)
    corrections = rng.normal(size=(cell.robot.frame_count, 6)) * 1e-2
    corrections[0] = 0.0
    markers = dict(zip(cell.marker_names, cell.markers, strict=True))
    text = corrected_robot(cell, "urdf", corrections, markers, tmp_path / "out.urdf").text
    model = in_mujoco(text)
    q = rng.uniform(-1.0, 1.0, (4, cell.robot.dof))
    every = np.zeros((4, model.nq))
    every[:, [int(model.joint(j).qposadr[0]) for j in cell.robot.joints]] = q
    base, right, left = np.moveaxis(
        body_positions(model, ["c0", "marker_right", "marker_left"], every), 1, 0
    )
    frames = forward(cell.robot, q, corrections)
    ours = [
        frames.o[:, frame] + frames.R[:, frame] @ point
        for frame, point in zip(cell.marker_frames, cell.markers, strict=True)
    ]
    # Lengths from the base and between the hands: in whatever axes MuJoCo has the base.
    for a, b, mine in (
        (right, base, ours[0]),
        (left, base, ours[1]),
        (right, left, ours[0] - ours[1]),
    ):
        np.testing.assert_allclose(
            np.linalg.norm(a - b, axis=1), np.linalg.norm(mine, axis=1), atol=1e-9
        )
