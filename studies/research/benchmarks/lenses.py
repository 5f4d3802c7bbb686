"""Days of a Panda with a camera on its hand, whose lens, arm or board errs.

It looks at a chessboard of 8 x 11 corners, 45 poses a day. The arm is read from its URDF and bent by
payload and compliance in this file, pixels are OpenCV's ``projectPoints``: nothing of it is shared with
posecal. The cell believes in the nominal lens and board, and identifies base, tool and geometry.

A: the lens is wrong in all its parts. B: two joints have offsets, one is elastic. C: both. D: the board
is 0.2 % too large. E, F, G: focal length, principal point, k1 alone. H: the camera slips at half-day.
I: the board is bowed by 1 mm. L: as A, and the focal length grows with the heat of the day by 0.15 %.
N: nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

import calib
from calib.arrays import Array
from studies.research.bench import data_folder
from studies.research.cameras import corners, frame, poses_that_show, standing
from studies.research.cameras import pixels as pixels_of

_FOCAL, _CENTER, _NOISE = 900.0, (640.0, 480.0), 0.1  # px
_POSES, _DRAWN, _FOR_EACH = 45, 4000, 8  # poses, and candidates: at least so many for each
_PAYLOAD, _GRAVITY = 3.0, 9.81  # kg at the tip, m/s^2
_COMPLIANCE = 8e-5  # rad/(N m) of the fourth joint
_INTERVAL = 120.0  # s, from one pose to the next
_CELL = """schema = 1
name = "panda with a camera"
[robot]
urdf = "{urdf}"
base = "base_link"
tip = "tool0"
[payload]
mass_kg = {mass}
com_mm = [0, 0, 0]
[boards.board]
on = "world"
squares = [12, 9]
pitch_mm = 20
{board_at}
[instruments.camera]
kind = "camera"
on = "tip"
focal_px = {focal}
center_px = {center}
image_px = [1280, 960]
sigma_px = {noise}
{camera_at}
[model]
effects = ["base", "tool", "geometry"]
"""
# Where the camera rides and the board stands: m, degrees about fixed x, y, z.
_CAMERA_AT = (0.05, 0.0, 0.05), (0.0, 0.0, 90.0)
_BOARD_AT = (0.5, -0.11, 0.0), (180.0, 0.0, 0.0)


@dataclass(frozen=True)
class Truth:
    """What errs on a day.

    focal : shares of fx and fy; centre : px; k1, k2; warming : growth of the focal length by the last
        pose; arm : zero for a perfect one; size : of the board; bow : m; slip : of the camera at
        half-day, m and rad
    """

    focal: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    k1: float = 0.0
    k2: float = 0.0
    warming: float = 0.0
    arm: float = 0.0
    size: float = 1.0
    bow: float = 0.0
    slip: tuple[float, ...] = (0.0,) * 6


_WRONG = Truth((0.006, 0.004), (3.5, -3.0), -0.03, 0.01)
_CASES = {
    "A": _WRONG,
    "B": Truth(arm=1.0),
    "C": replace(_WRONG, arm=1.0),
    "D": Truth(size=1.002),
    "E": Truth(focal=(0.005, 0.005)),
    "F": Truth(centre=(2.0, 0.0)),
    "G": Truth(k1=-0.02),
    "H": Truth(slip=(5e-4, -3e-4, 2e-4, 1e-3, -8e-4, 5e-4)),
    "I": Truth(bow=1e-3),
    "L": replace(_WRONG, warming=1.5e-3),
    "N": Truth(),
}


def written(folder: Path, name: str, seed: int, poses: int = _POSES) -> tuple[Path, Path]:
    """Cell and table of a day of so many poses in a folder."""
    truth = _CASES[name]
    rng = np.random.default_rng([seed, ord(name), len("tip")])
    chain = Chain(data_folder("panda_sockets_2") / "robot.urdf")
    path, table_path = folder / "cell.toml", folder / "measurements.csv"
    known = {"mass": _PAYLOAD, "focal": _FOCAL, "center": list(_CENTER), "noise": _NOISE}
    known |= {"camera_at": _stated(_CAMERA_AT), "board_at": _stated(_BOARD_AT)}
    path.write_text(_CELL.format(urdf=chain.path, **known))
    cell = calib.load_cell(path)
    q = poses_that_show(cell, rng, max(_DRAWN, _FOR_EACH * poses), poses)
    time: Array = _INTERVAL * np.arange(float(len(q)))
    uv = pixels(chain, q, truth)
    uv += rng.normal(0.0, _NOISE, uv.shape)
    table_path.write_text(_columns(cell.robot.joints, q, time, uv))
    return path, table_path


def _stated(place: tuple[tuple[float, ...], tuple[float, ...]]) -> str:
    position, rpy = place
    return f"position_mm = {[1e3 * x for x in position]}\nrpy_deg = {list(rpy)}"


class Chain:
    """A URDF's joints in a row."""

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        self.links: list[tuple[Array, bool]] = []
        for joint in ElementTree.parse(path).iter("joint"):
            origin = joint.find("origin").attrib
            xyz, rpy = (
                np.array(origin.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy")
            )
            turns = joint.get("type") == "revolute"
            self.links.append((frame(xyz, Rotation.from_euler("xyz", rpy).as_matrix()), turns))

    def frames(self, q: Array) -> list[Array]:
        """Frames of the joints, which turn about z, and of the tip last, for one pose (dof,)."""
        T, found, angles = np.eye(4), [], iter(q)
        for link, turns in self.links:
            T = T @ link
            if turns:
                found.append(T)
                about_z = Rotation.from_rotvec([0.0, 0.0, next(angles)])
                T = T @ frame(np.zeros(3), about_z.as_matrix())
        return [*found, T]


def pixels(chain: Chain, q: Array, truth: Truth) -> Array:
    """What a true camera sees, (m, 88, 2)."""
    bent = truth.k1, truth.k2, 0.0, 0.0, 0.0
    grid = corners(11, 8, 0.02) * truth.size
    across = (grid[:, 0] - grid[:, 0].mean()) / np.ptp(grid[:, 0]) * 2.0
    grid[:, 2] = truth.bow * (1.0 - across**2)
    camera, board = standing(*_CAMERA_AT), standing(*_BOARD_AT)
    slipped = frame(truth.slip[:3], Rotation.from_rotvec(truth.slip[3:]).as_matrix())
    found = []
    for k, own in enumerate(q):
        tip = bent_tip(chain, own, truth.arm)
        eye = camera @ slipped if 2 * k >= len(q) else camera
        seen = np.linalg.inv(tip @ eye) @ board
        warm = 1.0 + truth.warming * k / max(len(q) - 1, 1)
        f = [_FOCAL * warm * (1.0 + share) for share in truth.focal]
        c = np.add(_CENTER, truth.centre)
        found.append(pixels_of(grid, seen, f, c, bent))
    return np.array(found)


def bent_tip(chain: Chain, q: Array, arm: float) -> Array:
    """Frame of the tip of an arm that errs so much, zero for a perfect one."""
    true = q + arm * np.array([0.0, 8e-4, 0.0, -6e-4, 0.0, 0.0, 0.0])
    *joints, tip = chain.frames(true)
    lever = np.cross(tip[:3, 3] - joints[3][:3, 3], [0.0, 0.0, -_PAYLOAD * _GRAVITY])
    true[3] += arm * _COMPLIANCE * float(joints[3][:3, 2] @ lever)
    return chain.frames(true)[-1]


def _columns(joints: Sequence[str], q: Array, time: Array, uv: Array) -> str:
    head = ["pose", "instrument", "marker", "time_s", *(f"{j}_rad" for j in joints), "u_px", "v_px"]
    lines = [",".join(head)]
    for k, (own, at, points) in enumerate(zip(q, time, uv, strict=True)):
        shared = ",".join([f"{at:.3f}", *(f"{value:.9f}" for value in own)])
        lines += [
            f"p{k + 1:02d},camera,board:{i},{shared},{u:.5f},{v:.5f}"
            for i, (u, v) in enumerate(points)
        ]
    return "\n".join(lines) + "\n"
