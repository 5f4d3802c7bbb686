"""Photographs of a printed board, by MuJoCo's renderer or by OpenCV's homography of the print."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from calib.arrays import Array

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
SIZE = (960, 720)
FOCAL = 1000.0  # px
CENTER = ((SIZE[0] - 1) / 2.0, (SIZE[1] - 1) / 2.0)  # pixels have their centres at whole numbers
DOTS = 3000.0  # of a print, a metre
MARGIN = 90  # dots of white around it
SIDE = int(0.03 * DOTS)  # of a square
SQUARES = "squares = [9, 6]\npitch_mm = 30"
CHARUCO = f'{SQUARES}\nmarker_mm = 22\ndictionary = "5x5_100"'
TAGS = 'tags = [5, 4]\ntag_mm = 40\ngap_mm = 12\ndictionary = "DICT_APRILTAG_36h11"'

_SCENE = """<mujoco><visual><global offwidth="{W}" offheight="{H}"/><quality offsamples="8"/>
<headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/><map znear="0.001"/></visual>
<asset><texture name="t" type="2d" file="print.png"/>
<material name="m" texture="t" specular="0" shininess="0"/>
<mesh name="b" inertia="shell" texcoord="0 0 1 0 1 1 0 1 0.5 0.5"
 vertex="0 0 0 {w} 0 0 {w} {h} 0 0 {h} 0 {x} {y} 0.01"
 face="0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"/></asset><worldbody>
<geom type="mesh" mesh="b" material="m"/><camera name="c" fovy="{fovy}"/></worldbody></mujoco>"""


def chessboard() -> Any:
    """Nine squares across and six down, the first one dark."""
    i, j = np.indices((6 * SIDE, 9 * SIDE)) // SIDE
    return np.where((i + j) % 2 == 0, 0, 255).astype(np.uint8)


def _charuco_board() -> Any:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    return cv2.aruco.CharucoBoard((9, 6), 0.03, 0.022, words)


def charuco() -> Any:
    return _charuco_board().generateImage((9 * SIDE, 6 * SIDE), marginSize=0)


def tags() -> Any:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    board = cv2.aruco.GridBoard((5, 4), 0.04, 0.012, words)
    return board.generateImage((int(0.248 * DOTS), int(0.196 * DOTS)), marginSize=0)


def points_of(kind: str) -> Array:
    """Where a print has its points (n, 3), m."""
    if kind == "tags":
        clock = ((0, 0), (1, 0), (1, 1), (0, 1))
        at = [
            (0.052 * x + 0.04 * dx, 0.052 * y + 0.04 * dy)
            for y in range(4) for x in range(5) for dx, dy in clock
        ]  # fmt: skip
    else:
        at = [(0.03 * (x + 1), 0.03 * (y + 1)) for y in range(5) for x in range(8)]
    return np.c_[np.array(at), np.zeros(len(at))]


def found_by_opencv(kind: str, image: Any) -> int:
    """How many points of a print OpenCV finds in an image."""
    if kind == "chessboard":
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
        return 40 * bool(cv2.findChessboardCornersSB(image, (8, 5), flags=flags)[0])
    if kind == "charuco":
        ids = cv2.aruco.CharucoDetector(_charuco_board()).detectBoard(image)[1]
        return 0 if ids is None else len(ids)
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return 4 * len(cv2.aruco.ArucoDetector(words).detectMarkers(image)[0])


def pixels(points: Array, T: Array) -> Array:
    """A pinhole's pixels (n, 2) of points (n, 3), m, of a board at T in camera axes."""
    own = points @ T[:3, :3].T + T[:3, 3]
    return np.asarray(FOCAL * own[:, :2] / own[:, 2:] + CENTER)


def facing(turn: float, tilt: tuple[float, float], size: tuple[float, float], away: float) -> Array:
    """A board (4, 4) in camera axes: turned in its plane, tilted, its middle before the camera."""
    R = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.array([0.0, 0.0, away]) - R @ [size[0] / 2.0, size[1] / 2.0, 0.0]
    return T


def photograph(by: str, drawn: Any, T: Array) -> Any:
    """A print with its margin, its first dot at the board's origin, seen at T; skips without OpenGL."""
    paper = cv2.copyMakeBorder(drawn, *[MARGIN] * 4, cv2.BORDER_CONSTANT, value=255)
    there = T.copy()
    there[:3, 3] -= T[:3, :3] @ [MARGIN / DOTS, MARGIN / DOTS, 0.0]
    return (_rendered if by == "mujoco" else _warped)(paper, there)


def _warped(paper: Any, T: Array, over: int = 3) -> Any:
    height, width = paper.shape
    corners = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]]) / DOTS
    H, _ = cv2.findHomography(
        2.0 * corners[:, :2] * DOTS - 0.5, (pixels(corners, T) + 0.5) * over - 0.5
    )
    double = cv2.resize(paper, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
    large = cv2.warpPerspective(double, H, (over * SIZE[0], over * SIZE[1]), borderValue=90)
    return cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)


def _rendered(paper: Any, T: Array, over: int = 2) -> Any:
    mujoco = pytest.importorskip("mujoco")
    W, H = over * SIZE[0], over * SIZE[1]
    try:
        from mujoco.egl import GLContext

        context = GLContext(W, H)
        context.make_current()
    except Exception as error:  # whatever a machine without OpenGL says
        pytest.skip(f"no OpenGL: {error}")
    h, w = (n / DOTS for n in paper.shape)
    fovy = np.degrees(2.0 * np.arctan(SIZE[1] / 2.0 / FOCAL))
    text = _SCENE.format(W=W, H=H, w=w, h=h, x=w / 2.0, y=h / 2.0, fovy=fovy)
    model = mujoco.MjModel.from_xml_string(
        text, {"print.png": cv2.imencode(".png", paper)[1].tobytes()}
    )
    back = np.linalg.inv(T)
    turned = np.ascontiguousarray(back[:3, :3] @ np.diag([1.0, -1.0, -1.0]))
    model.cam_pos[0] = back[:3, 3]
    mujoco.mju_mat2Quat(model.cam_quat[0], turned.ravel())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene, own = mujoco.MjvScene(model, 10), mujoco.MjrContext(model, 100)
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, scene)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, own)
    view, image = mujoco.MjrRect(0, 0, W, H), np.zeros((H, W, 3), dtype=np.uint8)
    mujoco.mjr_render(view, scene, own)
    mujoco.mjr_readPixels(image, None, view, own)
    own.free()
    context.free()
    grey = cv2.cvtColor(image[::-1], cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, SIZE, interpolation=cv2.INTER_AREA)
