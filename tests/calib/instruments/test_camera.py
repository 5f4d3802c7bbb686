"""Cameras: the projection against OpenCV, places and lenses without a guess, the bound, tables, faults.

The truth is plain numpy with OpenCV's projection: a chain and frames that share no code with the
estimator.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.errors import InputError
from calib.files.write_tables import measurements_csv
from calib.instruments import ArmCamera, FixedCamera
from calib.instruments.board import Board
from calib.instruments.lens import Lens
from calib.model.build import build
from studies.research.cameras import pixels
from tests.camera_cells import LENS, board_text, camera_text, kr270_cell
from tests.helpers import central_difference
from tests.plain_arm import frame, looking, tips
from tests.studies.command_line import run

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
PIXELS = np.array([1920.0, 1080.0])
OFF = {"A2": 8e-4, "A3": -6e-4, "A5": 1.1e-3}
HOME = np.radians([10.0, -60.0, 80.0, 15.0, 40.0, 20.0])
TILED = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) * 0.06
SOLID = np.random.default_rng(4).uniform(-0.08, 0.08, (9, 3))


def projected(points: Array, lens: Array = LENS) -> Array:
    """Pixels (..., 2) of points (..., 3), camera axes, by OpenCV."""
    found = pixels(points.reshape(-1, 3), np.eye(4), lens[:2], lens[2:4], lens[4:])
    return found.reshape((*points.shape[:-1], 2))


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Writes a cell of the KR 270 with these tables, and returns its path."""

    def write(*tables: str, effects: tuple[str, ...] = ("base", "tool", *OFFSETS)) -> Path:
        return kr270_cell(tmp_path, *tables, effects=effects)

    return write


OFFSETS = tuple(f"joint_offset:{joint}" for joint in OFF)


def tip_frames(cell: calib.Cell, q: Array) -> Array:
    """Of the true arm, whose joints are off."""
    error = np.array([OFF.get(joint, 0.0) for joint in cell.robot.joints])
    return tips(cell.robot, q + error)


def near_home(count: int, seed: int, spread: float = 0.5) -> Array:
    return HOME + np.random.default_rng(seed).uniform(-spread, spread, (count, 6))


def inside(pixels: Array) -> Array:
    return np.asarray(((pixels > 0.0) & (pixels < PIXELS)).all(axis=-1))


Rows = list[tuple[int, str, str, Array]]


def table(path: Path, joints: tuple[str, ...], q: Array, rows: Rows) -> Path:
    """Rows of pose, instrument, marker and pixels as a table."""
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(
            ["pose", "instrument", "marker", *(f"{j}_deg" for j in joints), "u_px", "v_px"]
        )
        for i, camera, marker, (u, v) in rows:
            degrees = [f"{x:.12g}" for x in np.degrees(q[i])]
            out.writerow([f"p{i:03d}", camera, marker, *degrees, f"{u:.10g}", f"{v:.10g}"])
    return path


def seen_on_tip(
    cell: calib.Cell, q: Array, boards: dict[str, tuple[Array, Array]], cameras: dict[str, Array]
) -> Rows:
    """What cameras (frames in base axes) see of boards: points, and their frame on the tip."""
    T, rows = tip_frames(cell, q), []
    for camera, C in cameras.items():
        for name, (points, X) in boards.items():
            there = points @ X[:3, :3].T + X[:3, 3]
            world = np.einsum("mij,nj->mni", T[:, :3, :3], there) + T[:, None, :3, 3]
            own = (world - C[:3, 3]) @ C[:3, :3]
            pixels = projected(own)
            rows += [
                (i, camera, f"{name}:p{k}", pixels[i, k])
                for i, k in np.argwhere(inside(pixels) & (own[..., 2] > 0.1)).tolist()
            ]
    return rows


def seen_from_tip(
    cell: calib.Cell, q: Array, boards: dict[str, tuple[Array, Array]], camera: Array
) -> Rows:
    """What a camera on the tip sees of boards: points, and their frame in the base."""
    T, rows = tip_frames(cell, q) @ camera, []
    for name, (points, B) in boards.items():
        world = points @ B[:3, :3].T + B[:3, 3]
        own = np.einsum("mji,mnj->mni", T[:, :3, :3], world[None] - T[:, None, :3, 3])
        pixels = projected(own)
        rows += [
            (i, "eye", f"{name}:p{k}", pixels[i, k])
            for i, k in np.argwhere(inside(pixels) & (own[..., 2] > 0.1)).tolist()
        ]
    return rows


def noisy(rows: Rows, seed: int, sigma: float = 0.2) -> Rows:
    rng = np.random.default_rng(seed)
    return [(i, c, m, uv + rng.normal(scale=sigma, size=2)) for i, c, m, uv in rows]


def watched(
    written: Callable[..., Path],
    shape: Array,
    count: int,
    more: str = "",
    lens: Array = LENS,
    seed: int | None = None,
) -> tuple[calib.Cell, Path]:
    """A cell with a camera in the world that watches a board, and a table of what it saw.

    more, lens : of the camera in the cell; seed : of the noise, None for none
    """
    path = written(board_text("b", "tip", shape), camera_text("cam", "world", more, lens))
    cell, q = calib.load_cell(path), near_home(count, 1)
    X = frame(np.array([0.05, -0.1, 0.2, 0.4, 2.0, -0.3]))
    C = looking(tip_frames(cell, q)[:, :3, 3].mean(axis=0), np.array([3.6, -1.2, 2.2]))
    rows = seen_on_tip(cell, q, {"b": (shape, X)}, {"cam": C})
    rows = rows if seed is None else noisy(rows, seed)
    return cell, table(path.parent / "m.csv", cell.robot.joints, q, rows)


def assert_true(found: calib.Identification, tolerance: float) -> None:
    at = {p.where: k for k, p in enumerate(found.model.parameters) if p.effect == "joint_offset"}
    off = [found.values[at[joint]] for joint in OFF]
    np.testing.assert_allclose(off, list(OFF.values()), atol=tolerance)


# -- the lens ------------------------------------------------------------------------------------


def test_projection_is_opencvs() -> None:
    points = np.random.default_rng(0).uniform([-0.8, -0.5, 1.0], [0.8, 0.5, 3.0], (200, 3))
    np.testing.assert_allclose(Lens(LENS).project(points), projected(points), rtol=1e-12)
    ideal = points[:, :2] / points[:, 2:]
    near = np.abs(ideal).max(axis=1) < 0.5
    np.testing.assert_allclose(Lens(LENS).ideal(projected(points[near])), ideal[near], atol=1e-9)


def cameras() -> list[FixedCamera | ArmCamera]:
    board = Board("b", slice(0, len(SOLID)), SOLID)
    other = Board("c", slice(len(SOLID), len(SOLID) + len(TILED)), TILED)
    lens = {"lens": Lens(LENS), "sigma": 0.2, "free": np.arange(9)}
    return [FixedCamera(boards=(board,), **lens), ArmCamera(boards=(board, other), **lens)]


@pytest.mark.parametrize("camera", cameras(), ids=["fixed", "arm"])
def test_derivatives_by_place_and_lens(camera: FixedCamera | ArmCamera) -> None:
    """Those by points are in ``tests.properties``."""
    rng = np.random.default_rng(2)
    count = sum(len(board.points) for board in camera.boards)
    m, k = 3, 3 * camera.each
    place = rng.normal(scale=0.05, size=len(camera.unknowns))
    if isinstance(camera, FixedCamera):
        place[:6] = [0.1, -0.2, 2.0, 0.3, -0.2, 0.4]
        points = rng.uniform(-0.3, 0.3, (m, count, k))
    else:
        place[[2, 8]] = 2.0
        corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, -0.1]])
        points = corners + rng.normal(scale=0.05, size=(m, count, 3, 3))
        points = points.reshape(m, count, 9)
    found = camera.linearise(place, points)
    np.testing.assert_allclose(found.rows, camera.read(place, points))
    by_place = central_difference(
        lambda x: camera.read(x, points), place, np.full(len(place), 1e-4)
    )
    np.testing.assert_allclose(found.by_place, by_place, atol=1e-8 * np.abs(by_place).max())


# -- places, boards and lenses without a guess -----------------------------------------------------


@pytest.mark.parametrize("shape", [TILED, SOLID], ids=["plane", "solid"])
def test_a_camera_in_the_world(written: Callable[..., Path], shape: Array) -> None:
    cell, path = watched(written, shape, 25)
    found = calib.identify(cell, calib.load_measurements(cell, path))
    assert found.status == "converged"
    assert_true(found, 1e-8)
    assert found.by_instrument["cam", "px"]["fitted"] < 1e-4


def test_single_points_in_many_images(written: Callable[..., Path]) -> None:
    """One point of the shape in each image: no image tells a pose of anything by itself."""
    path = written(board_text("b", "tip", SOLID), camera_text("cam", "world"))
    cell, q = calib.load_cell(path), near_home(90, 5, 0.7)
    X = frame(np.array([0.02, 0.05, 0.1, -0.4, 0.5, 1.3]))
    C = looking(tip_frames(cell, q)[:, :3, 3].mean(axis=0), np.array([4.0, 1.0, 2.5]))
    rng, rows = np.random.default_rng(0), seen_on_tip(cell, q, {"b": (SOLID, X)}, {"cam": C})
    seen = [[row for row in rows if row[0] == i] for i in range(90)]
    alone = [own[int(rng.integers(len(own)))] for own in seen if own]
    data = calib.load_measurements(cell, table(path.parent / "m.csv", cell.robot.joints, q, alone))
    found = calib.identify(cell, data)
    assert_true(found, 1e-7)


def test_markers_and_two_cameras(written: Callable[..., Path]) -> None:
    """Two cameras that see markers, whose places are unknown: they know no length but the arm's."""
    spheres = np.array([[0.1, 0.0, 0.15], [-0.1, 0.08, 0.2]])
    listed = ", ".join(f"p{i} = [0.0, 0.0, 0.0]" for i in range(2))
    markers = f"[markers_mm]\n{listed.replace(', p', chr(10) + 'p')}\n"
    path = written(markers, camera_text("left", "world"), camera_text("right", "world"))
    cell, q = calib.load_cell(path), near_home(40, 6)
    middle = tip_frames(cell, q)[:, :3, 3].mean(axis=0)
    frames = {
        "left": looking(middle, np.array([3.5, 1.5, 2.0])),
        "right": looking(middle, np.array([3.5, -1.5, 2.0])),
    }
    rows = seen_on_tip(cell, q, {"b": (spheres, np.eye(4))}, frames)
    rows = [(i, camera, marker.removeprefix("b:"), uv) for i, camera, marker, uv in rows]
    data = calib.load_measurements(cell, table(path.parent / "m.csv", cell.robot.joints, q, rows))
    found = calib.identify(cell, data)
    assert_true(found, 1e-7)
    np.testing.assert_allclose(found.marker_positions, spheres, atol=1e-6)
    assert found.model.scaleless


@pytest.mark.parametrize("boards", [1, 2])
def test_a_camera_on_the_arm(written: Callable[..., Path], boards: int) -> None:
    """And a table written of it is the table read."""
    shapes = {"b": TILED, "c": SOLID + np.array([0.5, 0.1, 0.0])}
    shapes = {name: shapes[name] for name in list(shapes)[:boards]}
    tables = [board_text(name, "world", points) for name, points in shapes.items()]
    path = written(*tables, camera_text("eye", "tip"))
    cell, q = calib.load_cell(path), near_home(40, 3, 0.35)
    eye = frame(np.array([0.05, 0.08, 0.1, 0.1, -0.2, 0.5]))
    central = tip_frames(cell, HOME[None])[0] @ eye
    B = central @ frame(np.array([-0.15, -0.1, 1.3, 0.3, 0.2, -0.4]))
    rows = seen_from_tip(cell, q, {name: (points, B) for name, points in shapes.items()}, eye)
    assert len(rows) > 200
    data = calib.load_measurements(cell, table(path.parent / "m.csv", cell.robot.joints, q, rows))
    found = calib.identify(cell, data)
    assert_true(found, 1e-7)
    assert found.by_instrument["eye", "px"]["fitted"] < 1e-3
    (path.parent / "again.csv").write_text(measurements_csv(cell, data))
    again = calib.load_measurements(cell, path.parent / "again.csv")
    np.testing.assert_array_equal(again.seen, data.seen)
    np.testing.assert_allclose(again.readings, data.readings, atol=1e-8)
    assert build(cell, data.poses).model.channel_names[0] == "b:p0"


@pytest.mark.parametrize("given", ["free", "believed", "listed"])
def test_a_lens_that_is_not_known(written: Callable[..., Path], given: str) -> None:
    """Focal lengths and centre are found; told with deviations, they are not known worse than told."""
    guess = LENS + np.array([25.0, -15.0, 8.0, -6.0, *[0.0] * 5])
    more = {
        "free": 'free = ["focal", "center"]',
        "believed": "intrinsics_std = { focal_px = 20.0, center_px = 10.0 }",
        "listed": "intrinsics_std = [20.0, 20.0, 10.0, 10.0]",
    }[given]
    cell, path = watched(written, TILED, 30, more, guess, seed=3)
    found = calib.identify(cell, calib.load_measurements(cell, path))
    at = {p.name: k for k, p in enumerate(found.model.parameters)}
    for name, off, told in (("fx", -25.0, 20.0), ("fy", 15.0, 20.0), ("cx", -8.0, 10.0)):
        value, std = found.values[at[name]], found.std[at[name]]
        assert abs(value - off) < 4.0 * std
        assert given == "free" or std < told


# -- the bound, tables, what is said -----------------------------------------------------------------


def test_the_command_speaks_of_pixels(written: Callable[..., Path]) -> None:
    cell, path = watched(written, TILED, 25, seed=1)
    asked = ("--holdout", 0.3, "--json", path.parent / "r")
    done = run("identify", cell.path, path, *asked)
    assert done.exit_code == 0, done.output
    assert re.search(r"fell from [\d.]+ to [\d.]+ px", " ".join(done.output.split()))
    fields = json.loads((path.parent / "r").read_text())
    (own,) = fields["instruments"]
    assert (own["instrument"], own["unit"]) == ("cam", "px")
    assert own["heldout"] == pytest.approx(0.2 * np.sqrt(2.0), rel=0.15)
    assert own["nominal"] > own["fitted"]
    assert set(fields["rms_mm"].values()) == {None}
    assert {row["instrument"] for row in fields["residuals"]} == {"cam"}
    assert np.hypot(fields["residuals"][0]["u_px"], fields["residuals"][0]["v_px"]) < 2.0


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ((camera_text("cam", "world"),), "nothing on the tip"),
        ((camera_text("cam", "tip"),), "nothing in the world"),
        ((board_text("b", "world", TILED), camera_text("cam", "world")), "nothing on the tip"),
        (
            ('[boards.b]\non = "tip"\nsquares = [5, 4]\n', camera_text("cam", "world")),
            "squares and pitch_mm go together",
        ),
        (
            (
                board_text("b", "tip", TILED),
                board_text("c", "world", TILED),
                camera_text("cam", "world"),
            ),
            "no camera on the tip",
        ),
    ],
)
def test_faults_of_cells(written: Callable[..., Path], tables: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        calib.load_cell(written(*tables))


def test_without_opencv_one_line_says_what_to_install(
    written: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(board_text("b", "tip", TILED), camera_text("cam", "world"))
    monkeypatch.setitem(sys.modules, "cv2", None)
    said = r"instruments.cam: is a camera, which needs OpenCV; pip install '.\[camera\]'$"
    with pytest.raises(InputError, match=said):
        calib.load_cell(path)


def test_a_point_that_is_no_points_of_its_board(written: Callable[..., Path]) -> None:
    """It may stand in the cell as long as nobody reads it."""
    far = np.concatenate([TILED, [[3.2e6, 0.0, 0.0]]])
    path = written(board_text("b", "tip", far), camera_text("cam", "world"))
    cell, q = calib.load_cell(path), near_home(2, 1)
    rows: Rows = [
        (0, "cam", "b:p0", np.array([9.0, 9.0])),
        (1, "cam", "b:p20", np.array([9.0, 9.0])),
    ]
    said = r"line 3.*'b:p20' is no point of \[boards.b\]; its points are b:p0, .*b:p11 \.\."
    with pytest.raises(InputError, match=said):
        calib.load_measurements(cell, table(path.parent / "m.csv", cell.robot.joints, q, rows))


def test_a_deviation_of_its_own(written: Callable[..., Path]) -> None:
    """Of a row in pixels; one in millimetres is none, and an empty one is the cell's."""
    two = (camera_text(name, "world") for name in ("cam", "other"))
    path = written(board_text("b", "tip", TILED), *two)
    cell, q = calib.load_cell(path), near_home(2, 1)
    rows: Rows = [(i, "cam", f"b:p{i}", np.array([9.0, 8.0])) for i in range(2)]
    text = table(path.parent / "m.csv", cell.robot.joints, q, rows).read_text().splitlines()

    def loaded(column: str, *given: str) -> calib.Measurements:
        ends = [column, *given]
        lines = [f"{line},{end}" for line, end in zip(text, ends, strict=True)]
        (path.parent / "own.csv").write_text("\n".join(lines) + "\n")
        return calib.load_measurements(cell, path.parent / "own.csv")

    data = loaded("sigma_px", "0.5", "")
    np.testing.assert_array_equal(data.sigma[data.seen], [0.5, np.nan])
    model = build(cell, data.poses).model
    W = model.readout.whitening(model.initial, data.poses, data.readings, data.sigma)
    np.testing.assert_allclose(W[data.seen][:, 0, 0], [2.0, 5.0])
    said = r"line 3, column sigma_mm.* in mm, and 'cam' reads px; give it in column sigma_px"
    with pytest.raises(InputError, match=said):
        loaded("sigma_mm", "", "0.5")
    with pytest.raises(InputError, match=r"line 2, column sigma_px.*above zero"):
        loaded("sigma_px", "-1", "")
