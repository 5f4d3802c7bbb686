"""Calibrations of OpenCV and ROS in cells: what OpenCV and a YAML reader of others make of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.errors import InputError
from calib.files.cell_out import extended_cell
from calib.files.lenses import lens_yaml, read_lens
from calib.instruments import Camera
from studies.research.cameras import corners, frame, pixels
from tests.camera_cells import camera_cell
from tests.studies.command_line import run

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
VALUES = np.array([1371.25, 1369.5, 962.75, 541.125, -0.12, 0.05, 8e-4, -5e-4, -0.01])
K = np.array([[VALUES[0], 0.0, VALUES[2]], [0.0, VALUES[1], VALUES[3]], [0.0, 0.0, 1.0]])

URDF = """<robot name="r"><link name="base"/><link name="a"/><link name="tip"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.2"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="tip"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint></robot>"""
CELL = camera_cell(
    "squares = [6, 5]\npitch_mm = 30", 'calibration = "lenses/cam.yaml"\nsigma_px = 0.2'
)
ROS = """image_width: 1920
image_height: 1080
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [1371.25, 0, 962.75, 0, 1369.5, 541.125, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.12, 0.05, 0.0008, -0.0005, -0.01]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
MESSAGE = """header:
  stamp:
    sec: 1
  frame_id: optical
height: 1080
width: 1920
distortion_model: plumb_bob
d:
- -0.12
- 0.05
- 0.0008
- -0.0005
- -0.01
k:
- 1371.25
- 0.0
- 962.75
- 0.0
- 1369.5
- 541.125
- 0.0
- 0.0
- 1.0
binning_x: 0
roi:
  x_offset: 0
  do_rectify: false
---
"""


def by_opencv(path: Path, D: np.ndarray, **more: float) -> Path:
    """What OpenCV's own writer makes of a calibration."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Fri Dec 13 03:24:31 2019")
    for key, value in {"image_width": 1920, "image_height": 1080, **more}.items():
        file.write(key, value)
    file.write("camera_matrix", K)
    file.write("distortion_coefficients", D.reshape(-1, 1))
    file.release()
    return path


def cell_of(folder: Path, text: str = "", cell: str = CELL) -> Path:
    (folder / "lenses").mkdir(exist_ok=True)
    (folder / "r.urdf").write_text(URDF)
    (folder / "cell.toml").write_text(cell)
    if text:
        (folder / "lenses" / "cam.yaml").write_text(text)
    return folder / "cell.toml"


@pytest.mark.parametrize("more", [0, 3, 9])
def test_what_opencv_writes(tmp_path: Path, more: int) -> None:
    """Coefficients of richer models are none where they are zero."""
    path = by_opencv(tmp_path / "c.yaml", np.pad(VALUES[4:], (0, more)))
    found = read_lens(path)
    np.testing.assert_array_equal(found.values, VALUES)
    assert found.image is not None
    assert (found.form, found.image.tolist()) == ("opencv", [1920.0, 1080.0])


@pytest.mark.parametrize("text", [ROS, MESSAGE])
def test_what_ros_writes(tmp_path: Path, text: str) -> None:
    cell = calib.load_cell(cell_of(tmp_path, text))
    (camera,) = cell.instruments
    assert isinstance(camera, Camera)
    assert camera.image is not None
    np.testing.assert_array_equal(camera.lens.values, VALUES)
    np.testing.assert_array_equal(camera.image, [1920.0, 1080.0])
    assert cell.robot_files[1:] == (tmp_path / "lenses" / "cam.yaml",)


def test_what_is_written_is_read_by_others(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(lens_yaml("cam", "opencv", VALUES, np.array([1920.0, 1080.0])))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(file.getNode("camera_matrix").mat(), K)
    np.testing.assert_array_equal(file.getNode("distortion_coefficients").mat().ravel(), VALUES[4:])
    assert file.getNode("image_width").real() == 1920.0
    file.release()
    np.testing.assert_array_equal(read_lens(path).values, VALUES)
    path.write_text(lens_yaml("left camera", "ros", VALUES, None))
    assert read_lens(path).form == "ros"
    yaml = pytest.importorskip("yaml")
    fields = yaml.safe_load(path.read_text())
    assert fields["camera_name"] == "left_camera"
    assert fields["camera_matrix"] == {"rows": 3, "cols": 3, "data": K.ravel().tolist()}
    assert np.array(fields["projection_matrix"]["data"]).reshape(3, 4)[:, :3].tolist() == K.tolist()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            ROS.replace("plumb_bob", "equidistant"),
            "distortion: has 5 coefficients, where a fisheye",
        ),
        (ROS + "covariance_intrinsics: [1, 2, 3]\n", "covariance: is no covariance of fx"),
        (ROS + "std_dev_intrinsics: [1, 2, -3, 1]\n", "are no standard deviations of fx"),
        (ROS.replace("plumb_bob", "thin_prism"), "distortion_model: .*'thin_prism'"),
        (
            ROS.replace("plumb_bob", "rational_polynomial").replace("-0.01]", "-0.01, 1, 0, 0]"),
            "distortion: has 8 coefficients, of the rational model",
        ),
        (ROS.replace("-0.01]", "-0.01, 1]"), "distortion: has 6 coefficients"),
        (ROS.replace("1371.25, 0,", "1371.25, 0.5,"), "camera matrix: has a skew of 0.5"),
        (ROS.replace("1371.25, 0,", "0, 0,"), "camera matrix: is not .fx, 0, cx"),
        (ROS.replace("1371.25, 0,", "wide, 0,"), "line 7: 'wide' is no number"),
        (ROS.replace("camera_matrix", "left_matrix"), "holds no camera matrix"),
        (ROS.replace("distortion_coefficients", "bent"), "names no distortion"),
        (MESSAGE.replace("x_offset: 0", "x_offset: 64"), "binned or cut"),
        (MESSAGE.replace("binning_x: 0", "binning_x: 2"), "binned or cut"),
        (ROS.replace("1920", "640"), "is of images of 640 x 1080, image_px of .*cam is another"),
        ("words\n", "line 1: holds neither 'key: value'"),
    ],
)
def test_calibrations_that_cannot_be_used(tmp_path: Path, text: str, said: str) -> None:
    cell = CELL.replace("sigma_px", "image_px = [1920, 1080]\nsigma_px")
    with pytest.raises(InputError, match=said):
        calib.load_cell(cell_of(tmp_path, text, cell))


@pytest.mark.parametrize("form", ["opencv", "ros"])
def test_a_fisheye_there_and_back(tmp_path: Path, form: str) -> None:
    fisheye = np.append(VALUES[:4], [-0.02, 0.011, -0.006, 0.0012])
    path = tmp_path / "lenses" / "cam.yaml"
    path.parent.mkdir()
    path.write_text(lens_yaml("cam", form, fisheye, np.array([1920.0, 1080.0])))
    np.testing.assert_array_equal(read_lens(path).values, fisheye)
    (camera,) = calib.load_cell(cell_of(tmp_path, path.read_text())).instruments
    assert isinstance(camera, Camera)
    assert camera.lens.model == "fisheye"
    np.testing.assert_array_equal(camera.lens.values, fisheye)


def test_a_fisheye_of_opencv(tmp_path: Path) -> None:
    path = by_opencv(tmp_path / "c.yaml", VALUES[4:8], fisheye_model=1)
    np.testing.assert_array_equal(read_lens(path).values, VALUES[:8])


def test_deviations_as_opencv_gives_them(tmp_path: Path) -> None:
    """calibrateCameraExtended has 18 of them, zero for what was fixed; a covariance goes before."""
    std = np.array([2.0, 1.5, 0.7, 0.9, 1e-3, 2e-3, 1e-4, 1e-4, 0.0, *[0.0] * 9])
    text = f"{ROS}std_dev_intrinsics: {std.tolist()}\n"
    (camera,) = calib.load_cell(cell_of(tmp_path, text)).instruments
    assert isinstance(camera, Camera)
    np.testing.assert_allclose(camera.believed[:8], std[:8])
    assert camera.free.tolist() == list(range(8))
    half = np.diag(std[:9]) @ np.tril(np.random.default_rng(0).normal(size=(9, 9)))
    path = tmp_path / "lenses" / "cam.yaml"
    path.write_text(lens_yaml("cam", "opencv", VALUES, None, half @ half.T))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    written = file.getNode("standard_deviation_intrinsics").mat().ravel()
    file.release()
    np.testing.assert_allclose(written, np.sqrt(np.diag(half @ half.T)))
    (camera,) = calib.load_cell(cell_of(tmp_path, path.read_text())).instruments
    assert isinstance(camera, Camera)
    rows = camera.belief[:, -8:]
    np.testing.assert_allclose(np.linalg.inv(rows.T @ rows), (half @ half.T)[:8, :8], rtol=1e-6)


def readings(path: Path) -> None:
    """Images of the board by OpenCV: two joints, the true lens, a camera half a metre away."""
    rng = np.random.default_rng(5)
    rows = ["pose,instrument,marker,j1_deg,j2_deg,u_px,v_px"]
    for pose, (a, b) in enumerate(rng.uniform(-0.5, 0.5, (25, 2))):
        Ra = cv2.Rodrigues(np.array([0.0, 0.0, a]))[0]
        Rb = cv2.Rodrigues(np.array([0.0, b, 0.0]))[0]
        tip = corners(5, 4, 0.03) + np.array([0.05, -0.07, 0.02])
        world = tip @ (Ra @ Rb).T + Ra @ [0.4, 0.0, 0.0] + np.array([0.0, 0.0, 0.2])
        T = frame([-0.45, 0.0, 0.8], np.diag([1.0, -1.0, -1.0]))
        uv = pixels(world, T, VALUES[:2], VALUES[2:4], VALUES[4:])
        rows += [
            f"p{pose},cam,b:{i},{np.degrees(a):.12g},{np.degrees(b):.12g},{u:.9f},{v:.9f}"
            for i, (u, v) in enumerate(uv)
        ]
    path.write_text("\n".join(rows))


def test_a_lens_that_was_free_is_written_as_found(tmp_path: Path) -> None:
    """In the form of the camera's own file; a cell that names it has the true lens."""
    guess = ROS.replace("1371.25", "1300.0").replace("541.125", "530.0")
    more = 'free = ["focal", "center"]\nsigma_px'
    path = cell_of(tmp_path, guess, CELL.replace("sigma_px", more))
    readings(tmp_path / "m.csv")
    call = ["identify", path, tmp_path / "m.csv", "--json", tmp_path / "r.json"]
    found = tmp_path / "lenses" / "found.yaml"
    done = run(*call, "--calibration", f"cam={found}")
    assert done.exit_code == 0, done.output
    lens = read_lens(found)
    assert lens.form == "ros"
    np.testing.assert_allclose(lens.values[:4], VALUES[:4], atol=1e-3)
    np.testing.assert_array_equal(lens.values[4:], VALUES[4:])
    assert "lenses/cam.yaml" in (tmp_path / "r.json").read_text()
    over = run(*call, "--calibration", tmp_path / "lenses/cam.yaml")
    assert over.exit_code == 2
    assert "is already an input" in " ".join(over.output.split())


def test_a_cell_written_elsewhere_names_the_same_calibration(tmp_path: Path) -> None:
    cell = calib.load_cell(cell_of(tmp_path, ROS))
    readings(tmp_path / "m.csv")
    poses = calib.load_measurements(cell, tmp_path / "m.csv").poses
    (tmp_path / "out").mkdir()
    target = tmp_path / "out" / "cell.toml"
    target.write_text(extended_cell(cell, [], poses, target).text)
    assert 'calibration = "../lenses/cam.yaml"' in target.read_text()
    (camera,) = calib.load_cell(target).instruments
    assert isinstance(camera, Camera)
    np.testing.assert_array_equal(camera.lens.values, VALUES)


def test_a_lens_that_was_known_is_not_written(tmp_path: Path) -> None:
    path = cell_of(tmp_path, ROS)
    readings(tmp_path / "m.csv")
    done = run("identify", path, tmp_path / "m.csv", "--calibration", "x.yaml")
    assert done.exit_code == 2
    assert "is given as known" in " ".join(done.output.split())


def test_focal_lengths_that_were_found_as_one(tmp_path: Path) -> None:
    """Their covariance is singular, and is believed all the same."""
    cov = np.zeros((9, 9))
    cov[:2, :2] = 4.0
    text = lens_yaml("cam", "opencv", VALUES, None, cov)
    (camera,) = calib.load_cell(cell_of(tmp_path, text)).instruments
    assert isinstance(camera, Camera)
    assert camera.free.tolist() == [0, 1]
    own = camera.belief[:, -2:]
    assert np.linalg.norm(own @ [2.0, 2.0]) == pytest.approx(1.0, rel=1e-3)
    assert np.linalg.norm(own @ [2.0, -2.0]) > 1e3
