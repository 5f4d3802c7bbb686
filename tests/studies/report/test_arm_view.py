"""The picture of the arm: its numbers against MuJoCo and the constraints, its drawing, its names."""

from __future__ import annotations

import re
from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from calib import Cell, Measurements, Poses
from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import displacement, rotate, so3_exp
from calib.arrays import Array
from calib.cell.planned import Planned
from calib.cell.targets import sobol_poses
from calib.poses import poses_at
from doe.constraints import hidden_by, scene_of, visible
from studies.demo.embedded import embedded_text, simulated
from studies.report.arm_drawing import Sheet
from studies.report.arm_scene import ArmScene, scene
from studies.report.arm_view import drawing, figure_html
from studies.report.page import asset
from tests.calib.arm.test_mujoco import in_mujoco
from tests.helpers import cell_of, random_robot, read_by
from tests.studies.report.cells import hostile, shaped

HALF = 0.51  # mm: half of what is rounded to
LINKS = [*(f"link_{k}" for k in range(1, 7)), "tool0"]


def bodies(q: Array) -> tuple[Array, Array]:
    """Origins (m, 7, 3) m of the links and axes (m, 3, 3) of the tip, from MuJoCo."""
    model = in_mujoco(embedded_text("kr270.urdf"))
    data = mujoco.MjData(model)
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in LINKS]
    origins, axes = [], []
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        origins.append(data.xpos[ids].copy())
        axes.append(data.xmat[ids[-1]].reshape(3, 3).copy())
    return np.array(origins), np.array(axes)


@pytest.fixture(scope="module")
def drawn(kr270: Cell, table_two: Poses) -> ArmScene:
    return scene(shaped(kr270), table_two)


def test_arm_and_markers_stand_where_mujoco_puts_them(kr270: Cell) -> None:
    poses = sobol_poses(kr270, 40, 3)
    origins, axes = bodies(poses.q)
    markers = origins[:, -1:] + rotate(axes[:, None], kr270.markers)
    found = scene(kr270, poses)
    arm = found.chain
    # A4, A5 and A6 meet in the wrist: the chain has one point for them.
    wanted = np.concatenate([np.zeros((40, 1, 3)), origins[:, [0, 1, 2, 3, 6]]], axis=1) * 1e3
    np.testing.assert_allclose(arm, wanted, atol=HALF)
    np.testing.assert_allclose(found.marker_points, markers * 1e3, atol=HALF)
    np.testing.assert_allclose(found.tip_axes, axes.swapaxes(1, 2), atol=1e-9)


def test_prismatic_joints_and_capsules_by_products_of_matrices() -> None:
    rng = np.random.default_rng(5)
    robot = random_robot(rng, 5, prismatic=[1, 3])
    capsule = Capsule((0.1, 0.0, 0.2), (0.4, -0.1, 0.0), 0.05)
    cell = replace(
        cell_of(robot, rng.uniform(-0.2, 0.2, (2, 3)), ["base"]), shapes=Shapes({"j2": (capsule,)})
    )
    q = rng.uniform(-0.5, 0.5, (4, 5))
    found = scene(cell, poses_at(q))
    for i, row in enumerate(q):
        T, origins = np.eye(4), [np.zeros(3)]
        for k, value in enumerate(row):
            motion = np.zeros(6)
            motion[:3] = robot.axes[k] * value * robot.prismatic[k]
            motion[3:] = robot.axes[k] * value * ~robot.prismatic[k]
            T = T @ robot.origins[k] @ displacement(motion)
            origins.append(T[:3, 3])
            if k == 1:
                ends = [(T @ [*end, 1.0])[:3] for end in (capsule.start, capsule.end)]
        T = T @ robot.origins[5]
        np.testing.assert_allclose(found.chain[i], np.array([*origins, T[:3, 3]]) * 1e3, atol=HALF)
        (body,) = found.bodies
        np.testing.assert_allclose(body.ends[i], np.array(ends) * 1e3, atol=HALF)
    assert found.shaped
    assert found.bodies[0].radius == 50
    assert found.units == ("deg", "mm", "deg", "mm", "deg")
    np.testing.assert_allclose(found.values[:, 1], q[:, 1] * 1e3, atol=0.0051)


def test_why_a_marker_is_hidden(kr270: Cell) -> None:
    cell = shaped(kr270)
    normals = np.array([[np.nan] * 3, [1.0, 0.0, 0.0], [np.nan] * 3])
    cell = replace(cell, marker_normals=normals)
    placed = scene_of(cell, sobol_poses(cell, 300, 1).q)
    seen, why = visible(placed), hidden_by(placed)
    assert set(why) == {(int(i), int(j)) for i, j in np.argwhere(~seen)}
    assert {w.split()[0] for w in why.values()} == {"turned", "behind"}
    assert all(j == 1 for (_, j), w in why.items() if w == "turned away")
    for cause, without in (
        ("behind obstacle 1 (box)", replace(cell, design=Planned())),
        ("behind A2", replace(cell, shapes=Shapes({**cell.shapes.capsules, "A2": ()}))),
    ):
        hidden = [key for key, w in why.items() if w == cause]
        assert hidden, cause
        left = hidden_by(scene_of(without, placed.q))
        assert all(left.get(key) != cause for key in hidden)
        assert any(key not in left for key in hidden), "nothing else hides some of them"


def test_measured_markers_come_into_the_base_frame(kr270: Cell, table_two: Poses) -> None:
    """A stiff arm without errors, markers far from their first guesses, an instrument anywhere."""
    cell = replace(kr270, effects=("base", "tool"))
    shift = np.array([[0.0, 60.0, -40.0], [25.0, 0.0, 80.0], [-70.0, 10.0, 0.0]])
    origins, axes = bodies(table_two.q)
    true = origins[:, -1:] + rotate(axes[:, None], cell.markers + shift * 1e-3)
    R, t = so3_exp(np.array([0.4, -2.0, 1.1])), np.array([5.0, -8.0, 2.0])
    data = Measurements(
        table_two, rotate(R, true) + t, np.ones((15, 3), bool), np.full((15, 3), np.nan)
    )
    found = scene(cell, data)
    np.testing.assert_allclose(found.marker_points, true * 1e3, atol=HALF)
    assert found.seen == "measured"
    assert not found.hidden


def test_a_marker_without_a_reading(kr270: Cell, table_two: Poses) -> None:
    data, _, _ = simulated(kr270, table_two, 0)
    seen = data.seen.copy()
    seen[3, 1] = False
    found = scene(kr270, replace(data, seen=seen))
    assert found.hidden == {(3, 1): "not measured"}
    assert found.readout(3)[1] == "markers m1, m3 measured; m2 not measured"
    nominal = scene(kr270, data.poses)
    np.testing.assert_array_equal(found.marker_points[3, 1], nominal.marker_points[3, 1])


def test_what_stands_around(drawn: ArmScene) -> None:
    box, ball, wall = drawn.around.obstacles  # the floor is not drawn twice
    corners = np.unique(np.rint(1e3 * np.concatenate(box.lines)), axis=0)
    assert len(corners) == 8
    half = np.linalg.norm([300, 250, 400])
    np.testing.assert_allclose(np.linalg.norm(corners - [1900, -1500, 400], axis=1), half, atol=1)
    np.testing.assert_allclose(
        np.linalg.norm(1e3 * ball.lines[0] - [-900, 1800, 500], axis=1), 300.0, atol=1.0
    )
    in_wall = (1e3 * np.concatenate(wall.lines) - [-2000, 0, 0]) @ [-2, 0, 1] / np.sqrt(5.0)
    assert np.abs(in_wall).max() < 2.0
    floor = drawn.around.floor
    assert drawn.around.step == 500
    assert (floor[..., 2] == 0).all()
    assert (floor % 500 == 0).all()
    arms = drawn.chain.reshape(-1, 3)[:, :2]
    assert (floor.min(axis=(0, 1))[:2] <= arms.min(axis=0)).all()
    assert (floor.max(axis=(0, 1))[:2] >= arms.max(axis=0)).all()


def parsed(shown: ArmScene) -> ElementTree.Element:
    return ElementTree.fromstring(str(drawing(shown, "k")))


def of_class(svg: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return [e for e in svg.iter() if name in (e.get("class") or "").split()]


def test_structure_of_the_drawing(drawn: ArmScene) -> None:
    svg = parsed(drawn)
    title, description, parts = svg
    assert (title.tag, description.tag, parts.get("class")) == ("title", "desc", "arm-parts")
    assert svg.get("role") == "img"
    assert svg.get("aria-labelledby", "").split() == [title.get("id"), description.get("id")]
    assert title.text == "kr270 milling cell: the arm at 15 poses"
    assert "A2 \N{MINUS SIGN}0.01\N{DEGREE SIGN} " in (description.text or "")
    for name in ("arm-all", "arm-tips"):
        (line,) = of_class(svg, name)
        assert line.get("d", "").count("M") == 15
    assert len(of_class(svg, "arm-rim")) == len(of_class(svg, "arm-body")) == len(drawn.bodies)
    assert len(of_class(svg, "arm-joint")) == drawn.chain.shape[1] - 1
    hidden = sum((0, j) in drawn.hidden for j in range(3))
    assert len(of_class(svg, "arm-blocked")) == hidden
    assert len(of_class(svg, "arm-sight")) == 3 - hidden
    texts = {e.text for e in svg.iter("text")}
    assert {"X", "Y", "Z", "m1", "m2", "m3", "instrument"} <= texts
    assert len(texts & {"obstacle 1 (box)", "obstacle 2 (sphere)", "obstacle 4 (halfspace)"}) == 3


def numbers(element: ElementTree.Element) -> list[tuple[float, float]]:
    pairs = re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", element.get("d", ""))
    return [(float(x), float(y)) for x, y in pairs]


def test_the_picture_fills_the_drawing(drawn: ArmScene) -> None:
    svg = parsed(drawn)
    shown = ("arm-all", "arm-floor", "arm-solid", "arm-plane", "arm-drop")
    at = np.array([p for name in shown for e in of_class(svg, name) for p in numbers(e)])
    assert (at >= 31.9).all()
    assert (at <= np.array([720, 480]) - 31.9).all()
    room = (at.max(axis=0) - at.min(axis=0)) / (np.array([720, 480]) - 64)
    assert room.max() == pytest.approx(1.0, abs=1e-3)


def test_nearer_bodies_are_drawn_over_farther_ones(drawn: ArmScene) -> None:
    """Seen from azimuth -52 and elevation 20 degrees: towards the viewer is this direction."""
    a, e = np.radians([-52.0, 20.0])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    middles = [body.ends[0].mean(axis=0) for body in drawn.bodies]
    order = np.argsort([middle @ towards for middle in middles])
    widths = [float(e.get("stroke-width", 0)) for e in of_class(parsed(drawn), "arm-body")]
    radii = np.array([drawn.bodies[i].radius for i in order])
    np.testing.assert_allclose(np.array(widths) / radii, widths[0] / radii[0], rtol=0.01)


def test_a_far_instrument_is_a_direction(kr270: Cell, table_two: Poses) -> None:
    cell = replace(kr270, instruments=read_by(stands=np.array([12.0, 5.0, 1.0])))
    found = scene(cell, table_two)
    assert found.around.far
    svg = parsed(found)
    assert not of_class(svg, "arm-instrument")
    away = np.linalg.norm(cell.instrument)
    assert f"instrument {away:.1f} m from base" in {e.text for e in svg.iter("text")}
    origins, axes = bodies(table_two.q)
    markers = origins[:, -1:] + rotate(axes[:, None], kr270.markers)
    towards = cell.instrument - markers
    towards *= 1500.0 / np.linalg.norm(towards, axis=-1, keepdims=True)
    sheet, lines = Sheet(found.around.frame), of_class(svg, "arm-sight")
    for j, line in enumerate(lines):
        ends = markers[0, j] * 1e3 + np.stack([np.zeros(3), towards[0, j]])
        np.testing.assert_allclose(numbers(line), sheet.at(ends), atol=3 * HALF * sheet.scale)
    assert len(lines) == 3


def test_every_class_has_its_look(drawn: ArmScene) -> None:
    sheet = asset("arm_view.css")
    elements = list(parsed(drawn)[2])
    classes = {name for e in elements for c in e.iter() for name in c.get("class", "").split()}
    assert len(classes) > 15
    for name in classes:
        assert re.search(rf"\.{name}[, ]", sheet)


def test_names_of_the_user_are_no_markup(kr270: Cell, table_two: Poses) -> None:
    html = str(figure_html(scene(hostile(kr270), table_two)))
    assert "alert(1)" in html
    assert "<script" not in html
    assert "<img" not in html


def test_a_chain_that_comes_back_to_a_point(kr270: Cell) -> None:
    """One pose, the second link folded onto the first: the chain goes there and back."""
    robot = kr270.robot
    origins = np.tile(np.eye(4), (7, 1, 1))
    origins[[1, 2], 0, 3] = 1.0
    cell = replace(
        kr270, robot=replace(robot, origins=origins, axes=np.tile([0.0, 0.0, 1.0], (6, 1)))
    )
    found = scene(cell, poses_at(np.array([[0.0, np.pi, 0.0, 0.0, 0.0, 0.0]])))
    at = found.chain[0].tolist()
    assert at == [[0, 0, 0], [1000, 0, 0], [0, 0, 0]]
