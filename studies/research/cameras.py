"""Days of cameras: OpenCV's pixels, poses that show whole boards, and a Panda with one on its hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from defusedxml import ElementTree
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import calib
from calib import Cell
from calib.arrays import Array
from doe.constraints import scene_of, visible
from doe.views import NUMBERS, looking, views_of
from studies.research.bench import data_folder

_AT_ONCE = 250  # candidates


def frame(position: ArrayLike, R: Array) -> Array:
    """A transform (4, 4), m."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    return T


def corners(across: int, down: int, pitch: float) -> Array:
    """Inner corners of a chessboard in its frame, (n, 3), row by row."""
    grid = [[x, y, 0.0] for y in range(1, down + 1) for x in range(1, across + 1)]
    return np.array(grid) * pitch


def pixels(
    points: Array, T: Array, focal: ArrayLike, center: ArrayLike, bent: ArrayLike = (0.0,) * 5
) -> Array:
    """OpenCV's pixels (n, 2) of points (n, 3) that are at T in camera axes.

    focal, center : px, of both axes or each; bent : distortion
    """
    import cv2

    K = np.eye(3)
    K[[0, 1], [0, 1]], K[:2, 2] = focal, center
    turn = cv2.Rodrigues(T[:3, :3])[0]
    uv, _ = cv2.projectPoints(points, turn, T[:3, 3], K, np.asarray(bent, dtype=float))
    return np.asarray(uv[:, 0])


def poses_that_show(
    cell: Cell, rng: np.random.Generator, drawn: int, count: int | None = None
) -> Array:
    """Joint values (n, dof), rad or m, at which all that cameras look at is seen.

    drawn : candidates; count : poses to end with, all that are found where None
    """
    low, high = cell.robot.sample_limits().T
    q = rng.uniform(low, high, (drawn, cell.robot.dof))
    even, free = rng.uniform(size=(drawn, NUMBERS)), np.ones(cell.robot.dof, dtype=bool)
    view, found = np.arange(drawn) % len(views_of(cell)), q[:0]
    for first in range(0, drawn, _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        there = looking(cell, q[part], view[part], even[part], free)
        found = np.concatenate([found, there[visible(scene_of(cell, there)).all(axis=1)]])
        if count is not None and len(found) >= count:
            break
    return found[:count]


# -- a Panda that films a board --------------------------------------------------------------------

_FOCAL, _CENTER, _NOISE = 900.0, (640.0, 480.0), 0.1  # px
_POSES, _DRAWN, _FOR_EACH = 45, 4000, 8  # poses, and candidates: at least so many for each
_INTERVAL = 120.0  # s, from one pose to the next
_CAMERA_AT, _BOARD_AT = (50.0, 0.0, 50.0), (500.0, -110.0, 0.0)  # mm
_CAMERA_RPY, _BOARD_RPY = (0.0, 0.0, 90.0), (180.0, 0.0, 0.0)  # deg
_CELL = f"""schema = 1
name = "panda with a camera"
[robot]
urdf = "{{urdf}}"
base = "base_link"
tip = "tool0"
[payload]
mass_kg = 3.0
com_mm = [0, 0, 0]
[boards.board]
on = "world"
squares = [12, 9]
pitch_mm = 20
position_mm = {list(_BOARD_AT)}
rpy_deg = {list(_BOARD_RPY)}
[instruments.camera]
kind = "camera"
on = "tip"
focal_px = {_FOCAL}
center_px = {list(_CENTER)}
image_px = [1280, 960]
sigma_px = {_NOISE}
position_mm = {list(_CAMERA_AT)}
rpy_deg = {list(_CAMERA_RPY)}
[model]
effects = ["base", "tool", "geometry"]
"""
LENSES = {
    "A": ((0.006, 0.004), (3.5, -3.0), (-0.03, 0.01)),
    "N": ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
}
"""What errs of a lens: shares of fx and fy, px of the centre, k1 and k2; N is right."""


def written(folder: Path, name: str, seed: int, poses: int = _POSES) -> tuple[Path, Path]:
    """Cell and table of a day of so many poses in a folder; name : of ``LENSES``.

    The arm is read from its URDF here, pixels are OpenCV's: nothing of it is shared with posecal. The
    cell believes in the nominal lens.
    """
    rng = np.random.default_rng([seed, ord(name), len("tip")])
    urdf = (data_folder("panda_sockets_2") / "robot.urdf").resolve()
    path, table_path = folder / "cell.toml", folder / "measurements.csv"
    path.write_text(_CELL.format(urdf=urdf))
    cell = calib.load_cell(path)
    q = poses_that_show(cell, rng, max(_DRAWN, _FOR_EACH * poses), poses)
    uv = _filmed(urdf, q, name)
    uv += rng.normal(0.0, _NOISE, uv.shape)
    joints = [f"{joint}_rad" for joint in cell.robot.joints]
    lines = [",".join(["pose", "instrument", "marker", "time_s", *joints, "u_px", "v_px"])]
    for k, (own, points) in enumerate(zip(q, uv, strict=True)):
        shared = ",".join([f"{_INTERVAL * k:.3f}", *(f"{value:.9f}" for value in own)])
        lines += [
            f"p{k + 1:02d},camera,board:{i},{shared},{u:.5f},{v:.5f}"
            for i, (u, v) in enumerate(points)
        ]
    table_path.write_text("\n".join([*lines, ""]))
    return path, table_path


def _filmed(urdf: Path, q: Array, name: str) -> Array:
    """What the true camera sees of the board, (m, 88, 2)."""
    focal, center, bent = LENSES[name]
    camera, board = _standing(_CAMERA_AT, _CAMERA_RPY), _standing(_BOARD_AT, _BOARD_RPY)
    f = [_FOCAL * (1.0 + share) for share in focal]
    lens = f, np.add(_CENTER, center), (*bent, 0.0, 0.0, 0.0)
    eyes = [np.linalg.inv(tip @ camera) for tip in _tips(urdf, q)]
    return np.array([pixels(corners(11, 8, 0.02), eye @ board, *lens) for eye in eyes])


def _standing(position_mm: Sequence[float], rpy_deg: Sequence[float]) -> Array:
    turn = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    return frame(np.array(position_mm) * 1e-3, turn)


def _tips(urdf: Path, q: Array) -> list[Array]:
    """Frames of the tip of a chain whose joints turn about z."""
    links = []
    for joint in ElementTree.parse(urdf).iter("joint"):
        origin = joint.find("origin").attrib
        xyz, rpy = ([float(x) for x in origin.get(k, "0 0 0").split()] for k in ("xyz", "rpy"))
        turn = Rotation.from_euler("xyz", rpy).as_matrix()
        links.append((frame(xyz, turn), joint.get("type") == "revolute"))
    tips = []
    for angles in q:
        T, left = np.eye(4), iter(angles)
        for link, turns in links:
            about_z = Rotation.from_rotvec([0.0, 0.0, next(left) if turns else 0.0])
            T = T @ link @ frame(np.zeros(3), about_z.as_matrix())
        tips.append(T)
    return tips
