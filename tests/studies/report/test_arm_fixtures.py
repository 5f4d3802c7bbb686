"""Instruments in the picture of the arm: where MuJoCo puts cameras and boards, and plain geometry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import calib
from calib import Cell, Poses
from calib.arrays import Array
from calib.instruments import Distance, Plane, Pose, Socket, Tracker
from calib.poses import Measurements, poses_at
from doe.constraints import scene_of
from studies.report.arm_instruments import InstrumentPlaces, fixtures, within
from studies.report.arm_scene import ArmScene, scene
from studies.report.arm_view import figure_html
from studies.report.surroundings import SceneObject
from tests.calib.instruments.test_camera_in_mujoco import (
    ARM,
    GRID,
    LENSES,
    SIZE,
    camera,
    cell_text,
    sites,
)

HALF = 0.51  # mm: half of what is rounded to
Q = np.random.default_rng(3).uniform(-0.3, 0.3, (4, 3))


def cameras_of(folder: Path) -> tuple[Cell, str]:
    words = {name: sites(name) for name in ("grip", "bench")}
    text = ARM.format(wall=camera("wall"), eye=camera("eye"), **words)
    (folder / "arm.xml").write_text(text)
    (folder / "cell.toml").write_text("".join(cell_text()))
    return calib.load_cell(folder / "cell.toml"), text


def mm(points: Array) -> Array:
    """Points (k, 3) or (m, k, 3), m, with an axis for poses, mm."""
    return np.asarray(1e3 * points.reshape(-1, *points.shape[-2:]))


def by_name(found: ArmScene) -> dict[str, SceneObject]:
    return {own.name: own for own in found.fixtures}


def test_cameras_and_boards_stand_where_mujoco_puts_them(tmp_path: Path) -> None:
    cell, text = cameras_of(tmp_path)
    found = scene(cell, poses_at(Q))
    drawn = by_name(found)
    assert [(own.name, own.kind) for own in found.fixtures] == [
        ("wall", "camera"), ("grip", "board"), ("eye", "camera"), ("bench", "board"),
    ]  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for i, q in enumerate(Q):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        for board in ("grip", "bench"):
            points = np.array([data.site(f"{board}{k}").xpos for k in range(len(GRID))]) * 1e3
            dots = mm(drawn[board].dots)
            np.testing.assert_allclose(dots[min(i, len(dots) - 1)], points, atol=HALF)
        for name in ("wall", "eye"):
            own, (fx, fy, cx, cy) = drawn[name], LENSES[name]
            at = data.cam(name).xpos * 1e3
            dots, lines = mm(own.dots), mm(own.lines[0])
            np.testing.assert_allclose(dots[min(i, len(dots) - 1), 0], at, atol=HALF)
            rim = lines[min(i, len(lines) - 1)] - at
            ahead = rim @ data.cam(name).xmat.reshape(3, 3) * [1.0, -1.0, -1.0]
            middle = (np.array(SIZE) - 1) / 2.0 - [cx, cy]
            pixels = ahead[:, :2] / ahead[:, 2:] * [fx, fy] + middle
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * 2.0 * middle
            np.testing.assert_allclose(pixels, corners, atol=10.0)  # of whole millimetres
    assert found.markers == ()
    assert not found.hidden


def test_what_a_camera_reads_is_said(tmp_path: Path) -> None:
    cell, _ = cameras_of(tmp_path)
    seen = np.zeros((4, 24), dtype=bool)
    seen[0, :2], seen[1, :20] = True, True
    data = Measurements(poses_at(Q), np.zeros((4, 24, 2)), seen, np.full((4, 24), np.nan))
    found = scene(replace(cell, effects=("joint_offset",)), data)
    assert found.readout(0)[1] == "wall reads grip:p0, grip:p1"
    assert found.readout(1)[1] == "wall reads 12 of 12 points; eye reads 8 of 12 points"
    assert found.readout(2)[1] == "nothing read"
    html = str(figure_html(found))
    assert "Instruments and markers as the cell gives them, or where" in html
    assert "camera and what it sees" in html
    assert ">marker" not in html


@pytest.fixture(scope="module")
def touched(kr270: Cell) -> Cell:
    """A ball on the KR 270 that instruments of many kinds read."""
    alone = {"markers": (0,)}
    return replace(
        kr270,
        instruments=(
            Distance(name="wire", anchor=np.array([1.5, 1.0, 0.1]), known=True, **alone),
            Plane(name="table", **alone),
            Socket(name="pair_0", sites=("pair_0", "pair_1", "other"), **alone),
            Tracker(name="tracker", **alone),
        ),
    )


PLACES = {
    "table": np.array([0.3, -0.2, 0.4]),
    "pair_0": np.array([1.0, 0.5, 0.2]),
    "pair_1": np.array([1.05, 0.5, 0.2]),
    "other": np.array([1.0, -0.5, 0.2]),
    "tracker": np.array([0.4, -0.1, 3.0, 0.0, 0.0, np.pi / 2]),
}


def test_what_is_touched(touched: Cell, table_two: Poses) -> None:
    places = scene_of(touched, table_two.q)
    placed = InstrumentPlaces(PLACES, touched.markers)
    drawn = {f.name: f for f in fixtures(touched, table_two, places, placed, 2.5)}
    ends = mm(drawn["wire"].lines[0])
    np.testing.assert_allclose(ends[:, 0], np.tile([1500, 1000, 100], (15, 1)), atol=HALF)
    np.testing.assert_allclose(ends[:, 1], places.markers[:, 0] * 1e3, atol=HALF)
    turn = np.hypot(0.3, 0.2)
    normal = np.array([-0.2 * np.sin(turn), -0.3 * np.sin(turn), np.cos(turn) * turn]) / turn
    for line in map(mm, drawn["table"].lines):
        np.testing.assert_allclose(line @ normal, 400.0, atol=2.0 * HALF)
    words = {name: drawn[name].words for name in ("pair_0", "pair_1", "other")}
    assert words == {"pair_0": "pair", "pair_1": "", "other": "other"}
    # The base turned by 90 deg about z stands at (0.4, -0.1, 3) in the tracker's frame.
    np.testing.assert_allclose(mm(drawn["tracker"].dots)[0, 0], [100, 400, -3000], atol=HALF)


def test_a_wire_goes_where_it_is_read(touched: Cell, table_two: Poses) -> None:
    seen = np.zeros((15, 4), dtype=bool)
    seen[2, 0] = True
    data = Measurements(table_two, np.zeros((15, 4, 3)), seen, np.full((15, 4), np.nan))
    found = scene(replace(touched, effects=("joint_offset",)), data)
    (line,) = by_name(found)["wire"].lines
    assert ((line[:, 0] != line[:, 1]).any(axis=1) == seen[:, 0]).all()
    assert found.readout(2)[1] == "wire reads m1"


def test_what_stands_far_off_is_told(kr270: Cell, touched: Cell, table_two: Poses) -> None:
    places = scene_of(touched, table_two.q)
    away = InstrumentPlaces({**PLACES, "other": np.array([30.0, 40.0, 0.0])}, touched.markers)
    drawn = tuple(fixtures(touched, table_two, places, away, 2.5))
    frame = scene(kr270, table_two).around.frame
    kept, beyond, wider = within(drawn, frame, 2500.0)
    assert beyond == {"other": pytest.approx(50.0)}
    assert "other" not in {own.name for own in kept}
    ends = np.concatenate([frame, *(np.rint(mm(own.dots)).reshape(-1, 3) for own in kept)])
    assert (wider.min(axis=0) <= ends.min(axis=0)).all()
    assert (wider.max(axis=0) >= ends.max(axis=0)).all()
    assert np.abs(wider).max() < 10_000
    shown = replace(scene(kr270, table_two), beyond=beyond)
    assert "Not in the picture: other stands 50.0 m from the base." in str(figure_html(shown))


def test_a_body_is_its_three_axes(kr270: Cell, table_two: Poses) -> None:
    corners = np.array([[0.1, 0.0, 0.2], [0.1, 1.0, 0.2], [-0.9, 0.0, 0.2]])  # turned about z
    cell = replace(
        kr270,
        marker_names=("hand", "hand:x", "hand:y"),
        markers=corners,
        marker_normals=np.full((3, 3), np.nan),
        marker_acceptance=np.full(3, np.nan),
        bodies={"hand": slice(0, 3)},
        instruments=(Pose(name="capture"),),
    )
    found = scene(cell, table_two)
    (own,) = found.fixtures
    assert (own.kind, own.name, found.markers) == ("frame", "hand", ())
    placed = scene_of(cell, table_two.q)
    R, p = placed.frames.R[:, -1], placed.origins[:, -1]
    for line, axis in zip(own.lines, np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]), strict=True):
        np.testing.assert_allclose(line[:, 0], R @ corners[0] + p, atol=HALF / 1e3)
        along = (line[:, 1] - line[:, 0]) / np.linalg.norm(line[:, 1] - line[:, 0], axis=1)[:, None]
        np.testing.assert_allclose(along, R @ axis, atol=0.02)
