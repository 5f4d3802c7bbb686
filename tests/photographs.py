"""Photographs of a printed board, by MuJoCo's renderer or by OpenCV's homography of the print."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from calib.files.exports.images import Pattern
from calib.files.exports.points import PointList
from calib.files.exports.sightings import file_shots, look, point_list

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
SIZE = (960, 720)
FOCAL = 1000.0  # px
CENTER = ((SIZE[0] - 1) / 2.0, (SIZE[1] - 1) / 2.0)  # pixels have their centres at whole numbers
DOTS = 3000.0  # of a print, a metre
MARGIN = 90  # dots of white around it

_SCENE = """<mujoco><visual><global offwidth="{W}" offheight="{H}"/><quality offsamples="8"/>
<headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/><map znear="0.001"/></visual>
<asset><texture name="t" type="2d" file="print.png"/>
<material name="m" texture="t" specular="0" shininess="0"/>
<mesh name="b" inertia="shell" texcoord="0 0 1 0 1 1 0 1 0.5 0.5"
 vertex="0 0 0 {w} 0 0 {w} {h} 0 0 {h} 0 {x} {y} 0.01"
 face="0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"/></asset><worldbody>
<geom type="mesh" mesh="b" material="m"/><camera name="c" fovy="{fovy}"/></worldbody></mujoco>"""


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


def read_images(
    paths: Sequence[Path], patterns: Sequence[Pattern], poses: Collection[str] = ()
) -> tuple[PointList, tuple[str, ...]]:
    """Every point of a board that images show, and the poses whose images do not count.

    An image is named as in :func:`file_shots`.

    Raises InputError where OpenCV is not installed, a file is no image, or no image shows a board.
    """
    seen = look(file_shots(paths, poses), patterns)
    read = point_list(paths[0].parent, seen, patterns)
    return read, tuple(own.shot.pose for own in seen if own.reason)
