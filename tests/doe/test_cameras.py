"""Plans for cameras: every pose is one that OpenCV's projection confirms; clean days hold no more."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import doe
from calib import load_cell
from calib.arm.se3 import from_xyz_rpy, transform
from calib.arrays import Array
from calib.cell import Cell
from doe import design
from doe.candidates import drawn
from doe.constraints import scene_of, visible
from doe.notes import granted_by
from doe.views import looking, views_of
from studies.command.explain import page
from tests.camera_cells import camera_text, kr270_cell
from tests.camera_days import SETUPS, Truth, corners, kr270_day, pixels
from tests.plain_arm import tips
from tests.trees import in_mujoco
from tests.two_arms import EYE, PLATE, in_view, urdf, written

SIZE, FOCAL = (960, 720), 1000.0  # px
CENTER = ((SIZE[0] - 1) / 2.0, (SIZE[1] - 1) / 2.0)
SQUARES = "squares = [9, 6]\npitch_mm = 30"
BOARD = f'[boards.b]\non = "{{on}}"\n{SQUARES}\nposition_mm = {{at}}\nrpy_deg = {{rpy}}\n'
CAMERA = f"""[instruments.cam]
kind = "camera"
focal_px = {FOCAL}
center_px = {list(CENTER)}
image_px = {list(SIZE)}
sigma_px = 0.1
on = "{{on}}"
position_mm = {{at}}
rpy_deg = {{rpy}}
"""
EFFECTS = ("base", "tool", "geometry")
IN_HAND = (
    BOARD.format(on="world", at=[1500, -100, 300], rpy=[180, 0, 0]),
    CAMERA.format(on="tip", at=[60, 0, 80], rpy=[0, 0, 90]),
)
IN_WORLD = (
    BOARD.format(on="tip", at=[100, -130, -90], rpy=[0, 180, 0]),
    CAMERA.format(on="world", at=[3200, 0, 1800], rpy=[-90, 0, 90]),
)


def placed(cell: Cell, q: Array) -> Array:
    """The board (m, 4, 4) in the camera's axes, link by link, by other code."""
    tip, (view,) = tips(cell.robot, q), views_of(cell)
    on_arm, in_world = tip @ view.tip, np.linalg.inv(view.world)
    if view.camera.parts == {} or cell.bodies.get("cam") is None:
        return in_world @ on_arm  # type: ignore[no-any-return]
    return np.linalg.inv(on_arm) @ view.world  # type: ignore[no-any-return]


def shown(T: Array, points: Array, focal: float, center: tuple[float, float]) -> bool:
    """Whether points in axes T of the camera are in its image, and lean no more than 60 degrees."""
    uv = pixels(points, T, focal, center)
    sight = points @ T[:3, :3].T + T[:3, 3]
    lean = np.arccos(sight @ T[:3, 2] / np.linalg.norm(sight, axis=1))
    inside = (uv >= -0.01) & (uv <= 2.0 * np.array(center) + 1.01)
    return bool(inside.all() and np.degrees(lean).max() <= 60.01)


def turned_there(cell: Cell, seed: int, count: int) -> tuple[Array, Array, Array]:
    """Poses anywhere, numbers that say where the board is wanted, and poses with it there."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(*cell.robot.sample_limits().T, (count, 6))
    even, nobody = rng.uniform(size=(count, 6)), np.zeros(count, dtype=int)
    return q, even, looking(cell, q, nobody, even, np.ones(6, dtype=bool))


@pytest.mark.parametrize("tables", [IN_HAND, IN_WORLD], ids=["in hand", "in the world"])
def test_poses_are_solved_for_and_show_the_board(tables: tuple[str, str], tmp_path: Path) -> None:
    cell = load_cell(kr270_cell(tmp_path, *tables, effects=EFFECTS))
    q, even, solved = turned_there(cell, 0, 1000)
    seen = [visible(scene_of(cell, own)).all(axis=1) for own in (q, solved)]
    assert seen[1].mean() > 3.0 * seen[0].mean()
    assert seen[1].mean() > 0.4
    (view,) = views_of(cell)
    boards = placed(cell, solved)
    off = np.abs(boards - view.placed(even, cell.robot.reach)).max(axis=(1, 2))
    assert (off < 1e-6).mean() > 0.05, "the arm is where the draw wanted it"
    assert all(shown(T, corners(8, 5, 0.03), FOCAL, CENTER) for T in boards[seen[1]])


def test_what_stands_before_a_board_hides_it(tmp_path: Path) -> None:
    wall = '[[design.obstacle]]\ntype = "box"\ncenter_mm = [1500, 0, 500]\nsize_mm = [2000, 2000, 10]\n'
    free = load_cell(kr270_cell(tmp_path, *IN_HAND, effects=EFFECTS))
    _, _, q = turned_there(free, 1, 500)
    q = q[visible(scene_of(free, q)).all(axis=1)]
    assert len(q) > 50
    walled = load_cell(kr270_cell(tmp_path, *IN_HAND, wall, effects=EFFECTS))
    above = tips(free.robot, q)[:, 2, 3] > 0.8
    hidden = ~visible(scene_of(walled, q)).any(axis=1)
    assert hidden[above].all()


@pytest.mark.parametrize(("link", "holds"), [("A3", False), ("A6", True)])
def test_a_board_is_in_no_link_but_the_wrist(tmp_path: Path, link: str, holds: bool) -> None:
    shape = f"[robot.capsules_mm]\n{link} = [{{from = [0, 0, 0], to = [9, 0, 0], radius = 1200}}]\n"
    cell = load_cell(kr270_cell(tmp_path, shape, *IN_WORLD, effects=EFFECTS))
    scene = scene_of(cell, turned_there(cell, 2, 500)[2])
    away = np.linalg.norm(scene.markers - scene.origins[:, None, int(link[1])], axis=2).max(axis=1)
    inside = np.asarray(visible(scene).all(axis=1))[away < 1.19]
    assert len(inside) > 50
    assert inside.any() == holds


def test_the_cell_of_the_page_sees_its_board(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", page("camera"), flags=re.S)
    kr270_cell(tmp_path, effects=EFFECTS)
    (tmp_path / "cell.toml").write_text(text.replace("arm.urdf", "kr270.urdf"))
    cell = load_cell(tmp_path / "cell.toml")
    q = np.concatenate(list(drawn(cell, 1024, None, 0)))
    assert visible(scene_of(cell, q)).any(axis=1).mean() > 0.2


T_HEAD_EYE = from_xyz_rpy(np.array([0.05, 0.0, 0.06]), np.radians([-110.0, 0.0, -90.0]))
T_HAND_PLATE = from_xyz_rpy(np.array([-0.04, -0.03, -0.02]), np.zeros(3))
CAPSULE = "[[robot.capsules_mm.{}]]\nfrom = {}\nto = {}\nradius = {}\n"


def between(cell: Cell, q: Array) -> Array:
    """The plate (m, 4, 4) in the camera's axes, by MuJoCo."""
    model = in_mujoco(urdf())
    data, found = mujoco.MjData(model), []
    for row in q:
        data.qpos[[int(model.joint(name).qposadr[0]) for name in cell.robot.joints]] = row
        mujoco.mj_forward(model, data)
        ends = []
        for name, T in (("head", T_HEAD_EYE), ("right_hand", T_HAND_PLATE)):
            body = data.body(name)
            ends.append(transform(body.xmat.reshape(3, 3), body.xpos) @ T)
        found.append(np.linalg.inv(ends[0]) @ ends[1])
    return np.array(found)


def test_every_pose_of_a_plan_shows_the_head_the_board(tmp_path: Path) -> None:
    cell = load_cell(written(tmp_path, PLATE, EYE, effects='"base", "tool", "joint_offset"'))
    plan = design(cell, poses=12, candidates=150)
    eye = (900.0, (640.0, 480.0))
    assert all(shown(T, corners(5, 4, 0.02), *eye) for T in between(cell, plan.poses.q))
    assert "hip, bend exact and rigid, as no instrument sees them err" in plan.granted
    assert not any("edge" in own for own in plan.granted)
    (eye,) = plan.problem.cell.instruments
    bare = replace(plan.problem, cell=replace(cell, instruments=(replace(eye, image=None),)))
    assert "images of eye without an edge, as no image_px is given" in granted_by(
        replace(plan, problem=bare)
    )


@pytest.mark.parametrize(
    ("capsule", "hides"),
    [
        # About the eye itself, as the head's shape is.
        (CAPSULE.format("tilt", [40, 0, 60], [60, 0, 60], 60), False),
        # The chest as large as what lies between most hands and the head.
        (CAPSULE.format("bend", [150, 0, 100], [150, 0, 250], 150), True),
    ],
)
def test_what_is_between_head_and_hand_hides(tmp_path: Path, capsule: str, hides: bool) -> None:
    free = load_cell(written(tmp_path, PLATE, EYE))
    q = in_view(free, 30, drawn=1000).q
    path = written(tmp_path, PLATE, EYE)
    path.write_text(path.read_text().replace("[boards.plate]", f"{capsule}[boards.plate]"))
    scene = scene_of(load_cell(path), q)
    assert visible(scene).all() is np.bool_(not hides)


OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])


@pytest.mark.parametrize(
    ("setup", "grows", "scatter", "seed"),
    [
        # A camera quieter than stated, a tracker as stated.
        ("kr270", False, 0.0, 0),
        ("kr270", True, 1.5e-5, 9),
        pytest.param("kr270, two", False, 0.0, 0, marks=pytest.mark.long),
    ],
)
def test_a_clean_day_has_nothing_systematic(
    tmp_path: Path, setup: str, grows: bool, scatter: float, seed: int
) -> None:
    """On one day in twenty chance looks like something: counted 2 of 60 for two cameras."""
    truth = Truth(OFF, seed=seed, grows=grows, scatter=scatter)
    found = doe.enough(*kr270_day(tmp_path, SETUPS[setup], truth, 30, 4))
    assert found.lacking.of_model <= 0.5 * found.steps[0].task_rms


@pytest.mark.parametrize(
    ("keys", "least"),
    [("", 40), ("marker_mm = 22", 20)],
    ids=["chessboard", "coded"],
)
def test_a_plan_counts_a_board_by_enough_of_its_points(
    tmp_path: Path, keys: str, least: int
) -> None:
    board = f'[boards.b]\non = "tip"\nsquares = [9, 6]\npitch_mm = 30\n{keys}\n'
    places = "position_mm = {}\nrpy_deg = [0, 0, 0]\n"
    tables = (
        board + places.format([0, 0, 100]),
        camera_text("cam", "world", places.format([3000, 0, 0])),
    )
    (camera,) = load_cell(kr270_cell(tmp_path, *tables, effects=("base", "tool"))).instruments
    assert [own.least for own in camera.boards] == [least]
