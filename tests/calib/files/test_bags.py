"""Recordings of ROS: an image at each stop with the joints of the stop; of a moving arm many more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.bags import grey, is_bag, recordings
from tests import ros_bags
from tests.calib.files.test_images import SQUARES, chessboard
from tests.camera_cells import PINHOLE, kr270_cell
from tests.photographs import CENTER, FOCAL, SIZE, cv2, facing, photograph

BOARD = f'[boards.b]\non = "tip"\n{SQUARES}\n'
CAMERA = f'[instruments.cam]\nkind = "camera"\non = "world"\n{PINHOLE}\n'
STOPS = np.radians([[0, -90, 90, 0, 0, 0], [10, -80, 95, 5, 0, 3], [20, -85, 80, -5, 9, 3]])
STAY, GO = 1.5, 1.0  # s
STEP, FRAME = 0.02, 0.25  # s
K = np.array([[FOCAL, 0.0, CENTER[0]], [0.0, FOCAL, CENTER[1]], [0.0, 0.0, 1.0]])


def way(time: Array) -> Array:
    """Joints (n, 6), rad: a stay at each stop, and an even move to the next."""
    knots = np.concatenate([[k * (STAY + GO), k * (STAY + GO) + STAY] for k in range(len(STOPS))])
    return np.stack([np.interp(time, knots, np.repeat(own, 2)) for own in STOPS.T], axis=1)


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> calib.Cell:
    folder = tmp_path_factory.mktemp("cell")
    return calib.load_cell(kr270_cell(folder, BOARD, CAMERA, effects=("base", "tool")))


@pytest.fixture(scope="module")
def bag(cell: calib.Cell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Each image is grey by its time, but for those of the stops, which show the board."""
    joints = np.arange(0.0, 3 * STAY + 2 * GO, STEP)
    frames = np.arange(0.1, joints[-1], FRAME)
    states = [
        (t, ros_bags.joint_state(cell.robot.joints, q, t))
        for t, q in zip(joints, way(joints), strict=True)
    ]
    images, bytes_ = [], []
    for time in frames.tolist():
        k = round((time - STAY / 2.0) / (STAY + GO))
        middle = abs(time - STAY / 2.0 - k * (STAY + GO)) <= STAY / 4.0
        pixels = np.full(SIZE[::-1], 100, np.uint8)
        if middle:
            T = facing(0.2 * k, (0.3, 0.1 * k), (0.25, 0.18), 0.5)
            pixels = photograph("homography", chessboard(), T)
        colour = np.repeat(pixels[..., None], 3, axis=2)
        images.append((time, ros_bags.image(colour, time, "bgr8", wide=2)))
        bytes_.append((time, ros_bags.compressed(cv2.imencode(".png", pixels)[1], time)))
    return ros_bags.written(
        tmp_path_factory.mktemp("bag") / "day",
        {
            "/joint_states": states,
            "/cam/image_raw": images,
            "/cam/image_raw/compressed": bytes_,
            "/cam/camera_info": [(0.0, ros_bags.camera_info(1.01 * K, SIZE, 0.0))],
        },
        mcap=True,
    )


def test_one_image_at_each_stop_with_the_joints_of_the_stop(cell: calib.Cell, bag: Path) -> None:
    assert is_bag(bag)
    with recordings(bag, cell.robot) as found:
        raw, packed = found
        assert (raw.topic, packed.topic) == ("/cam/image_raw", "/cam/image_raw/compressed")
        for own in found:
            assert (own.stops, len(own.shots), own.images) == (3, 3, 26)
            assert own.joints.joints == tuple(f"{name}_rad" for name in cell.robot.joints)
            q = np.array([row.values[:6] for row in own.joints.rows], dtype=float)
            np.testing.assert_allclose(q, STOPS, atol=1e-6)
            assert [row.pose for row in own.joints.rows] == [shot.pose for shot in own.shots]
            times = [float(row.values[6]) for row in own.joints.rows]
            np.testing.assert_allclose(times, np.arange(3) * (STAY + GO) + STAY / 2, atol=0.2)
        for a, b in zip(raw.shots, packed.shots, strict=True):
            assert a.load().std() > 50.0, "it shows the board"
            np.testing.assert_allclose(a.load(), b.load(), atol=1)
        np.testing.assert_allclose(raw.lens[:4], 1.01 * K[[0, 1, 0, 1], [0, 1, 2, 2]])


def test_a_moving_arm_has_the_joints_of_the_stamp(cell: calib.Cell, bag: Path) -> None:
    with recordings(bag, cell.robot, ["/cam/image_raw"], moving=True) as (own,):
        assert own.stops == 0
        assert 6 < len(own.shots) < own.images
        q = np.array([row.values for row in own.joints.rows], dtype=float)
        np.testing.assert_allclose(q[:, :6], way(q[:, 6]), atol=2e-3)
        assert np.abs(np.diff(q[:, :6], axis=0)).max(axis=1).min() > 0.035


def test_what_a_recording_lacks_is_said(cell: calib.Cell, bag: Path, tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"--topic: '/eye' is not in .*; images are in /cam/image"),
        recordings(bag, cell.robot, ["/eye"]),
    ):
        pass
    path = tmp_path / "a.mcap"
    path.write_bytes(b"none")
    with (
        pytest.raises(InputError, match=r"a\.mcap: is no recording that rosbags reads"),
        recordings(path, cell.robot),
    ):
        pass
    alone = ros_bags.written(
        tmp_path / "b", {"/i": [(0.0, ros_bags.image(np.zeros((4, 4), np.uint8), 0.0))]}
    )
    with (
        pytest.raises(InputError, match=r"holds no joint states of A1, A2"),
        recordings(alone, cell.robot),
    ):
        pass
    moving = np.arange(0.0, 2.0, STEP)
    states = [(t, ros_bags.joint_state(cell.robot.joints, np.full(6, t), t)) for t in moving]
    images = [(t, ros_bags.image(np.zeros((4, 4), np.uint8), t)) for t in (0.5, 1.0)]
    never = ros_bags.written(tmp_path / "c", {"/j": states, "/i": images})
    with (
        pytest.raises(InputError, match=r"at which the joints stand still.*; give --moving"),
        recordings(never, cell.robot),
    ):
        pass


@pytest.mark.parametrize(
    ("encoding", "code"),
    [("rgb8", "GRAY2RGB"), ("bgra8", "GRAY2BGRA"), ("bayer_rggb8", ""), ("mono16", "")],
)
def test_encodings(encoding: str, code: str) -> None:
    pixels = np.repeat(np.linspace(0, 255, 16, dtype=np.uint8)[None], 8, axis=0)
    given = cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{code}")) if code else pixels
    if encoding == "mono16":
        given = (pixels.astype("<u2") * 257).view(np.uint8)
    message = ros_bags.image(given, 0.0, encoding)
    message.width = 16
    np.testing.assert_allclose(
        grey(cv2, message)[2:-2, 2:-2].astype(float), pixels[2:-2, 2:-2], atol=3
    )
    message.encoding = "yuv422"
    with pytest.raises(InputError, match="images are encoded as 'yuv422'"):
        grey(cv2, message)
