"""Cameras: the projection against OpenCV, boards, places and lenses without a guess, tables, faults.

The truth is plain numpy with OpenCV's projection: a chain and frames that share no code with the
estimator.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.errors import InputError
from calib.files.write_tables import measurements_csv
from calib.instruments.board import Board
from calib.instruments.lens import Lens
from calib.instruments.placing import rotation
from calib.instruments.resection import poses_of
from calib.model.build import build
from tests import instrument_days as scenes
from tests.camera_cells import LENS, board_text, camera_text, kr270_cell
from tests.camera_days import SETUPS, SIGMA_M, Truth, kr270_day
from tests.instrument_days import OFF, TILES, projected, sights, spread, tabled, true_tips
from tests.plain_arm import frame, looking
from tests.studies.command_line import run

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
SOLID = np.random.default_rng(4).uniform(-0.08, 0.08, (9, 3))
STANDS = np.array([3.6, -1.2, 2.2])
Write = Callable[..., Cell]


@pytest.fixture
def written(tmp_path: Path) -> Write:
    """Writes a cell of the KR 270 with these tables, and reads it."""
    return lambda *tables: calib.load_cell(kr270_cell(tmp_path, *tables, effects=scenes.EFFECTS))


def middle(cell: Cell, q: Array) -> Array:
    return true_tips(cell, q)[:, :3, 3].mean(axis=0)


def watched(
    written: Write, shape: Array, count: int, more: str = "", lens: Array = LENS,
    seed: int | None = None,
) -> tuple[Cell, Measurements]:  # fmt: skip
    """A camera in the world watches a board, and is stated with a lens and more.

    seed : of the noise, None for none
    """
    cell = written(board_text("b", "tip", shape), camera_text("cam", "world", more, lens))
    q = spread(1, count)
    C, rng = looking(middle(cell, q), STANDS), None if seed is None else np.random.default_rng(seed)
    rows = sights("cam", "b", shape, true_tips(cell, q) @ scenes.PLATE, C, rng)
    return cell, tabled(cell, q, rows)


def off_by(found: calib.Identification) -> tuple[Array, Array]:
    """Offsets of the joints, and their covariance."""
    at = [i for i, p in enumerate(found.model.parameters) if p.effect == "joint_offset"]
    return found.values[at], found.covariance[np.ix_(at, at)]


def assert_true(found: calib.Identification, tolerance: float) -> None:
    assert found.status == "converged"
    np.testing.assert_allclose(off_by(found)[0], OFF[[1, 2, 4]], atol=tolerance)


# -- The lens


def test_projection_is_opencvs() -> None:
    points = np.random.default_rng(0).uniform([-0.8, -0.5, 1.0], [0.8, 0.5, 3.0], (200, 3))
    np.testing.assert_allclose(Lens(LENS).project(points), projected(points), rtol=1e-12)
    ideal = points[:, :2] / points[:, 2:]
    near = np.abs(ideal).max(axis=1) < 0.5
    np.testing.assert_allclose(Lens(LENS).ideal(projected(points[near])), ideal[near], atol=1e-9)


@pytest.mark.parametrize("setup", ["kr270, hand", "kr270, two"])
def test_pixels_are_where_cameras_and_boards_are_said_to_be(tmp_path: Path, setup: str) -> None:
    """Places and turns of the cell against frames by hand: nothing is moved, and nothing is noisy."""
    still = Truth(
        np.zeros(6), moved=(0.0, 0.0), scales=dict.fromkeys(("cam", "left", "right"), 0.0)
    )
    cell, data = kr270_day(tmp_path, SETUPS[setup], still, 12, effects='"base", "tool"')
    model = build(cell, data.poses).model
    pixels = model.predict(model.initial, data.poses)
    assert data.seen.sum() > 100
    # The table has four digits.
    np.testing.assert_allclose(pixels[data.seen], data.readings[data.seen], atol=6e-5)


# -- Boards


@pytest.mark.parametrize(
    ("turn", "hidden", "said"),
    [(0.0, 0, True), (58.0, 0, True), (60.0, 0, False), (180.0, 0, False), (0.0, 1, False)],
    ids=["faced", "leaning", "leaning too far", "its back", "a chessboard is found whole"],
)
def test_a_board_is_seen_from_its_face_and_whole(turn: float, hidden: int, said: bool) -> None:
    points = np.array([[x, y, 0.0] for y in range(3) for x in range(4)]) * 0.02
    board = Board("b", slice(0, 12), points, 0.02, 8.0, 12)
    R = cv2.Rodrigues(np.array([np.radians(turn), 0.0, 0.0]))[0]
    viewed = (points - points.mean(axis=0)) @ R.T + [0.0, 0.0, 1.0]
    found = board.found(viewed, np.arange(12) >= hidden, np.radians(60.0))
    assert bool(found.all()) == said


LARGE = np.array([[x, y, 0.0] for y in range(8) for x in range(11)]) * 0.02


def test_five_lines_of_sight_stand_for_a_board() -> None:
    parts = list(Board("b", slice(0, 88), LARGE).parts())
    assert len(parts) == 5
    assert sorted(k for few, _ in parts for k in few) == list(range(88))
    assert all(one in few for few, one in parts)
    assert {0, 10, 77, 87} <= {one for _, one in parts}, "the corners"


def test_noise_grows_as_figures_look_smaller() -> None:
    """As days drawn by another formula have it, too: test_each_instrument_has_its_own_noise."""
    board = Board("b", slice(0, 88), LARGE, 0.02, 10.0, 88)
    faced = LARGE[:, :2] * 1000.0 + 640.0  # squares of 20 px
    assert board.noise(faced) == pytest.approx(np.sqrt(2.0))
    leaning = faced * [1.0, 0.5]
    assert board.noise(leaning) == pytest.approx(np.sqrt(5.0)), "across its shorter side"
    part, line = (np.arange(88)[:, None] % 3 > 0), np.arange(88)[:, None] < 11
    assert board.noise(faced * part) == pytest.approx(np.sqrt(2.0)), "what is hidden is zero"
    assert board.noise(faced * line) == 1.0, "points on a line show no side"
    assert board.noise(faced * 0.0) == 1.0


# -- Poses of shapes from one image: exact ones, both of a plane, none of a line

SQUARE = np.array([[0.0, 0, 0], [0.06, 0, 0], [0.06, 0.06, 0], [0, 0.06, 0]])
GRID = np.array([[x, y, 0.0] for y in range(5) for x in range(7)]) * 0.02
SMALL = np.random.default_rng(4).uniform(-0.05, 0.05, (9, 3))
TURNED = GRID @ so3_exp(np.array([0.4, -0.8, 0.3])).T + 0.2


def views(points: Array, count: int, seed: int) -> list[tuple[Array, Array, Array]]:
    """Rotations, translations and OpenCV's rays of shapes that face the camera within 60 deg."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        R = so3_exp(rng.normal(size=3) * 2.0)
        if R[2, 2] >= 0.5:
            t = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.4, 1.0)])
            rays, _ = cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, np.eye(3), np.zeros(5))
            found.append((R, t, rays[:, 0]))
    return found


@pytest.mark.parametrize("points", [SQUARE, GRID, SMALL, SQUARE[[0, 2, 1, 3]], TURNED])
def test_exact_rays_give_the_pose_first(points: Array) -> None:
    for R, t, rays in views(points, 100, 1):
        own, there, cost = poses_of(rays, points)[0]
        assert np.abs(own - R).max() < 1e-4
        assert np.abs(there - t).max() < 1e-4
        assert cost < 1.0


def test_a_plane_has_two_poses_a_solid_one_and_a_line_none() -> None:
    rng = np.random.default_rng(0)
    for points, count in ((SQUARE, 2), (SMALL, 1)):
        seen = [rays + rng.normal(scale=3e-4, size=rays.shape) for *_, rays in views(points, 60, 2)]
        assert [len(poses_of(rays, points)) for rays in seen].count(count) >= 54
    line = np.array([[0.02, 0, 0]]) * np.arange(5)[:, None]
    assert not poses_of(line[:, :2] + 0.1, line)


@pytest.mark.parametrize(("rows", "error"), [(5, 0.0), (9, 0.0), (9, 2.0)])
def test_the_rotation_of_least_squares_is_that_of_a_search(rows: int, error: float) -> None:
    rng = np.random.default_rng(rows)
    factor, R = rng.normal(size=(rows, 9)), Rotation.random(rng=rng).as_matrix()
    target = factor @ R.ravel() + error * rng.normal(size=rows)
    found = rotation(factor / 1e-6, target / 1e-6)
    if not error:
        np.testing.assert_allclose(found, R, atol=1e-9)
        return

    def cost(r: Array) -> float:
        return float(np.sum((target - factor @ Rotation.from_rotvec(r).as_matrix().ravel()) ** 2))

    starts = Rotation.random(30, rng=np.random.default_rng(1)).as_rotvec()
    least = min(minimize(cost, start, method="BFGS").fun for start in starts)
    assert np.sum((target - factor @ found.ravel()) ** 2) <= least * (1.0 + 1e-9)
    for own in (found, rotation(np.zeros((3, 9)), np.zeros(3))):  # one that nothing tells, too
        np.testing.assert_allclose(own @ own.T, np.eye(3), atol=1e-12)


# -- Places, boards and lenses without a guess


@pytest.mark.parametrize("shape", [TILES, SOLID], ids=["plane", "solid"])
def test_a_camera_in_the_world(written: Write, shape: Array) -> None:
    assert_true(calib.identify(*watched(written, shape, 25)), 1e-8)


def test_single_points_in_many_images(written: Write) -> None:
    """One point of the shape in each image: no image tells a pose of anything by itself."""
    cell = written(board_text("b", "tip", SOLID), camera_text("cam", "world"))
    q, rng = spread(5, 90, 0.7), np.random.default_rng(0)
    X = frame(np.array([0.02, 0.05, 0.1, -0.4, 0.5, 1.3]))
    C = looking(middle(cell, q), np.array([4.0, 1.0, 2.5]))
    rows = sights("cam", "b", SOLID, true_tips(cell, q) @ X, C)
    seen = [[row for row in rows if row[0] == i] for i in range(90)]
    alone = [own[int(rng.integers(len(own)))] for own in seen if own]
    assert_true(calib.identify(cell, tabled(cell, q, alone)), 1e-7)


def test_markers_and_two_cameras(written: Write) -> None:
    """Two cameras that see markers, whose places are unknown: they know no length but the arm's."""
    spheres = np.array([[0.1, 0.0, 0.15], [-0.1, 0.08, 0.2]])
    markers = "[markers_mm]\np0 = [0.0, 0.0, 0.0]\np1 = [0.0, 0.0, 0.0]\n"
    cell = written(markers, *(camera_text(name, "world") for name in ("left", "right")))
    q, rows = spread(6, 40), []
    for name, y in (("left", 1.5), ("right", -1.5)):
        C = looking(middle(cell, q), np.array([3.5, y, 2.0]))
        seen = sights(name, "", spheres, true_tips(cell, q), C)
        rows += [(i, name, str(marker)[1:], *uv) for i, _, marker, *uv in seen]
    found = calib.identify(cell, tabled(cell, q, rows))
    assert_true(found, 1e-7)
    np.testing.assert_allclose(found.marker_positions, spheres, atol=1e-6)
    assert found.model.scaleless


@pytest.mark.parametrize("boards", [1, pytest.param(2, marks=pytest.mark.long)])
def test_a_camera_on_the_arm(written: Write, boards: int) -> None:
    """And a table written of it is the table read."""
    shapes = dict(list({"b": TILES, "c": SOLID + np.array([0.5, 0.1, 0.0])}.items())[:boards])
    tables = [board_text(name, "world", points) for name, points in shapes.items()]
    cell, q = written(*tables, camera_text("eye", "tip")), spread(7, 40, 0.35)
    floor = true_tips(cell, scenes.HOME[None])[0] @ scenes.EYE @ scenes.AHEAD
    C = true_tips(cell, q) @ scenes.EYE
    rows = [row for name, own in shapes.items() for row in sights("eye", name, own, floor, C)]
    data = tabled(cell, q, rows)
    assert_true(calib.identify(cell, data), 1e-7)
    cell.path.with_name("again.csv").write_text(measurements_csv(cell, data))
    again = calib.load_measurements(cell, cell.path.with_name("again.csv"))
    np.testing.assert_array_equal(again.seen, data.seen)
    np.testing.assert_allclose(again.readings, data.readings, atol=1e-8)


GIVEN = {
    "free": 'free = ["focal", "center"]',
    "believed": "intrinsics_std = { focal_px = 20.0, center_px = 10.0 }",
}


@pytest.mark.parametrize("given", GIVEN)
def test_a_lens_that_is_not_known(written: Write, given: str) -> None:
    """Focal lengths and centre are found; told with deviations, they are not known worse than told."""
    guess = LENS + np.array([25.0, -15.0, 8.0, -6.0, *[0.0] * 5])
    found = calib.identify(*watched(written, TILES, 30, GIVEN[given], guess, seed=3))
    at = {p.name: k for k, p in enumerate(found.model.parameters)}
    for name, off, told in (("fx", -25.0, 20.0), ("fy", 15.0, 20.0), ("cx", -8.0, 10.0)):
        value, std = found.values[at[name]], found.std[at[name]]
        assert abs(value - off) < 4.0 * std
        assert given == "free" or std < told


# -- Tables, and what is said


def test_the_command_speaks_of_pixels(written: Write) -> None:
    cell, _ = watched(written, TILES, 25, seed=1)
    table, out = (cell.path.with_name(name) for name in ("measurements.csv", "r"))
    done = run("identify", cell.path, table, "--holdout", 0.3, "--json", out)
    assert done.exit_code == 0, done.output
    assert re.search(r"fell from [\d.]+ to [\d.]+ px", " ".join(done.output.split()))
    fields = json.loads(out.read_text())
    (own,) = fields["instruments"]
    assert (own["instrument"], own["unit"]) == ("cam", "px")
    assert own["heldout"] == pytest.approx(0.2 * np.sqrt(2.0), rel=0.15)
    assert own["nominal"] > own["fitted"]
    assert set(fields["rms_mm"].values()) == {None}
    assert {row["instrument"] for row in fields["residuals"]} == {"cam"}
    assert np.hypot(fields["residuals"][0]["u_px"], fields["residuals"][0]["v_px"]) < 2.0


HALF_A_BOARD = '[boards.b]\non = "tip"\nsquares = [5, 4]\n'
ON_TIP, ON_FLOOR = board_text("b", "tip", TILES), board_text("c", "world", TILES)
CAM = camera_text("cam", "world")


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ((CAM,), "camera cam and nothing that it sees; .* on = 'tip'"),
        ((camera_text("cam", "tip"),), "camera cam and nothing that it sees; .* on = 'world', or"),
        ((ON_FLOOR, CAM), "camera cam and nothing that it sees"),
        ((HALF_A_BOARD, CAM), "squares and pitch_mm go together"),
        ((ON_TIP, ON_FLOOR, CAM), "board c on world and no instrument elsewhere that reads it"),
        # Where OpenCV is not installed.
        ((ON_TIP, CAM, ""), r"cam: is a camera, which needs OpenCV; pip install '.\[camera\]'$"),
    ],
)
def test_faults_of_cells(
    written: Write, tables: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "OpenCV" in said:
        monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=said):
        written(*tables)


def test_a_point_that_is_no_points_of_its_board(written: Write) -> None:
    """It may stand in the cell as long as nobody reads it."""
    far = np.concatenate([TILES, [[3.2e6, 0.0, 0.0]]])
    cell = written(board_text("b", "tip", far), CAM)
    rows = [(0, "cam", "b:p0", 9.0, 9.0), (1, "cam", "b:p20", 9.0, 9.0)]
    said = r"line 3.*'b:p20' is no point of \[boards.b\]; its points are b:p0, .*b:p11 \.\."
    with pytest.raises(InputError, match=said):
        tabled(cell, spread(1, 2), rows)


def test_a_deviation_of_its_own(written: Write) -> None:
    """Of a row in pixels; one in millimetres is none, and an empty one is the cell's."""
    cell, q = written(ON_TIP, CAM, camera_text("other", "world")), spread(1, 2)

    def loaded(column: str, *given: float | str) -> Measurements:
        rows = [(i, "cam", f"b:p{i}", 9.0, 8.0, own) for i, own in enumerate(given)]
        return tabled(cell, q, rows, ("u_px", "v_px", column))

    data = loaded("sigma_px", 0.5, "")
    np.testing.assert_array_equal(data.sigma[data.seen], [0.5, np.nan])
    model = build(cell, data.poses).model
    W = model.readout.whitening(model.initial, data.poses, data.readings, data.sigma)
    np.testing.assert_allclose(W[data.seen][:, 0, 0], [2.0, 5.0])
    said = r"line 3, column sigma_mm.* in mm, and 'cam' reads px; give it in column sigma_px"
    with pytest.raises(InputError, match=said):
        loaded("sigma_mm", "", 0.5)
    with pytest.raises(InputError, match=r"line 2, column sigma_px.*above zero"):
        loaded("sigma_px", -1.0, "")


# -- Of several instruments each has its own noise, and what one has too much is not the other's


def noisy_day(folder: Path, setup: str, **truth: object) -> tuple[Cell, Measurements]:
    effects = str(truth.pop("effects", '"base", "tool", "geometry"'))
    return kr270_day(folder, SETUPS[setup], Truth(OFF, **truth), 26, 4, effects=effects)


@pytest.mark.parametrize(
    ("setup", "scales"),
    [
        ("kr270", {"cam": 0.5, "tracker": 2.0}),
        ("kr270, hand", {"cam": 2.0}),
        pytest.param("kr270", {}, marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("scatter", [0.0, 2e-5])
def test_each_instrument_has_its_own_noise(
    tmp_path: Path, setup: str, scales: dict[str, float], scatter: float
) -> None:
    cell, data = noisy_day(tmp_path, setup, seed=3, scales=scales, scatter=scatter)
    found = calib.identify(cell, data)
    own = found.model.noise_scales
    if len(cell.instruments) == 1:  # its noise has a level of its own
        assert not own
        assert found.noise.sigma / found.noise.stated == pytest.approx(2.0, rel=0.1)
        return
    assert own == {name: pytest.approx(times, rel=0.1) for name, times in scales.items()}
    assert found.noise.factor == pytest.approx(1.0, abs=0.02)


def test_a_model_that_lacks_something_makes_no_instrument_noisy(tmp_path: Path) -> None:
    """What the arm does moves all that rides on its tip as one."""
    cell, data = noisy_day(tmp_path, "kr270", scales={"cam": 2.0}, effects='"base", "tool"')
    found = calib.identify(cell, data)
    assert found.rms("fitted") > 10.0 * SIGMA_M
    assert found.model.noise_scales == {"cam": pytest.approx(2.0, rel=0.1)}


@pytest.mark.long
def test_what_is_off_is_off_by_its_deviation(tmp_path: Path) -> None:
    """Beside a camera twice as noisy as stated: two days, three offsets each."""
    own, squares = {"effects": '"base", "tool", "joint_offset:A2,A3,A5"', "moved": (0.0, 0.0)}, 0.0
    for seed in range(2):
        scales = {"cam": 2.0, "tracker": 0.7}
        day = noisy_day(tmp_path, "kr270", seed=seed, scales=scales, **own)
        values, covariance = off_by(calib.identify(*day))
        missed = values - OFF[[1, 2, 4]]
        squares += float(missed @ np.linalg.solve(covariance, missed))
    assert 1.24 < squares < 14.4, "a chi-square of 6, 19 times in 20"


def test_the_noise_of_an_instrument_is_told(tmp_path: Path) -> None:
    noisy_day(tmp_path, "kr270", scales={"cam": 2.0})
    said = run("identify", tmp_path / "cell.toml", tmp_path / "measurements.csv").output
    assert "Noise of cam: 2.0 times as stated" in said
    assert "0.0200 mm in each coordinate, as the cell states" in said
    assert "noise of tracker" not in said


@pytest.mark.long
def test_the_diagnosis_weighs_by_it(tmp_path: Path) -> None:
    found = calib.diagnose(*noisy_day(tmp_path, "kr270", seed=2, scales={"cam": 2.0}))
    assert found.after.model.noise_scales["cam"] == pytest.approx(2.0, rel=0.1)
    assert (found.verdict, found.rest.kind, found.causes) == ("no_gap", "none", ())
    assert found.noise.sigma == pytest.approx(SIGMA_M, rel=0.05)
