"""Days with cameras: cells of every set-up, and what is read there, by OpenCV's ``projectPoints``.

The arm is composed link by link in :mod:`tests.plain_arm`; nothing here knows how posecal projects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from calib import Cell, Measurements, load_cell, load_measurements
from calib.arm.robot import Robot
from calib.arrays import Array
from doe.constraints import scene_of, visible
from doe.views import NUMBERS, looking, views_of
from studies.demo.embedded import embedded_text
from tests.plain_arm import frame, tips

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
IMAGE = (1280, 960)
LENS = np.array([1000.0, 1000.0, 639.5, 479.5, 0.0, 0.0, 0.0, 0.0, 0.0])
SIGMA_PX, SIGMA_M = 0.1, 2e-5
SQUARES, PITCH = (9, 6), 0.03
MARKERS = np.array([[0.05, 0.0, 0.03], [-0.03, 0.05, 0.03], [-0.03, -0.05, 0.03]])


@dataclass(frozen=True)
class Stands:
    """Where a camera or a board is thought to be: ``on`` tip or world, mm and deg."""

    on: str
    position_mm: Sequence[float]
    rpy_deg: Sequence[float]

    def keys(self) -> str:
        return (
            f'on = "{self.on}"\nposition_mm = {list(self.position_mm)}\n'
            f"rpy_deg = {list(self.rpy_deg)}\n"
        )

    def frame(self) -> Array:
        """In the axes of what it stands on, (4, 4)."""
        roll, pitch, yaw = (frame(np.r_[0, 0, 0, a]) for a in np.diag(np.radians(self.rpy_deg)))
        T = yaw @ pitch @ roll
        T[:3, 3] = np.array(self.position_mm) / 1e3
        return T


@dataclass(frozen=True)
class Setup:
    """Cameras and boards by name; tracker : three markers on the tip are read, too."""

    cameras: Mapping[str, Stands]
    boards: Mapping[str, Stands]
    tracker: bool = False

    def text(self, urdf: str, base: str, tip: str, effects: str = '"base", "tool", "geometry"',
             more: str = "") -> str:  # fmt: skip
        """The cell."""
        tables = [f'schema = 1\n[robot]\nurdf = "{urdf}"\nbase = "{base}"\ntip = "{tip}"\n']
        if self.tracker:
            rows = (f"m{k} = {(1e3 * m).tolist()}\n" for k, m in enumerate(MARKERS, 1))
            tables.append("[markers_mm]\n" + "".join(rows))
            tables.append(
                f'[instruments.tracker]\nkind = "points"\nsigma_mm = {1e3 * SIGMA_M}\n'
                "position_mm = [3000, 1000, 1000]\n"
            )
        for name, stands in self.boards.items():
            printed = f"squares = {list(SQUARES)}\npitch_mm = {1e3 * PITCH}\n"
            tables.append(f"[boards.{name}]\n{printed}{stands.keys()}")
        for name, stands in self.cameras.items():
            lens = f"focal_px = {LENS[0]}\ncenter_px = {LENS[2:4].tolist()}\nimage_px = {list(IMAGE)}\n"
            tables.append(
                f'[instruments.{name}]\nkind = "camera"\nsigma_px = {SIGMA_PX}\n{lens}'
                f"{stands.keys()}{more}"
            )
        return "".join(tables) + f"[model]\neffects = [{effects}]\n"


_AT_ONCE = 250  # candidates


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


TABLE = Stands("world", [450, -120, 20], [180, 0, 0])
HAND = Stands("tip", [60, 0, 40], [0, 0, 90])
SETUPS = {
    "hand": Setup({"cam": HAND}, {"table": TABLE}),
    "fixed": Setup(
        {"cam": Stands("world", [1500, 0, 500], [-90, 0, 90])},
        {"plate": Stands("tip", [130, -75, 20], [0, 180, 0])},
    ),
    "two": Setup(
        {
            "left": Stands("world", [1500, 600, 500], [-90, 0, 115]),
            "right": Stands("world", [1500, -600, 500], [-90, 0, 65]),
        },
        {"plate": Stands("tip", [130, -75, 20], [0, 180, 0])},
    ),
    "tracker": Setup({"cam": HAND}, {"table": TABLE}, tracker=True),
    # The same before a KR 270, which is larger.
    "kr270": Setup(
        {"cam": Stands("tip", [60, 0, 80], [0, 0, 90])},
        {"table": Stands("world", [1500, -100, 300], [180, 0, 0])},
        tracker=True,
    ),
    "kr270, hand": Setup(
        {"cam": Stands("tip", [60, 0, 80], [0, 0, 90])},
        {"table": Stands("world", [1500, -100, 300], [180, 0, 0])},
    ),
    "kr270, two": Setup(
        {
            "left": Stands("world", [3200, 700, 1800], [-90, 0, 105]),
            "right": Stands("world", [3200, -700, 1800], [-90, 0, 75]),
        },
        {"plate": Stands("tip", [100, -130, -90], [0, 180, 0])},
    ),
    "boards": Setup(
        {"cam": HAND},
        {"table": TABLE, "side": Stands("world", [-100, 480, 20], [180, 0, 0])},
    ),
}


@dataclass(frozen=True, eq=False)
class Truth:
    """How the day differs from its cell.

    offsets : of the joints, rad; lens : of every camera, as OpenCV writes it, px
    moved : how far cameras and boards are from where the cell says, (m, rad); size : of the boards
    seed : of the noise; stands : of where cameras and boards are
    scales : times the stated noise, of each instrument by its name
    grows : whether noise of an image grows as squares look smaller, else it is the same in all
    scatter : rad, of every joint anew at every stop
    """

    offsets: Array
    lens: Array = field(default_factory=LENS.copy)
    moved: tuple[float, float] = (0.01, 0.02)
    size: float = 1.0
    seed: int = 0
    stands: int = 0
    scales: Mapping[str, float] = field(default_factory=dict)
    grows: bool = True
    scatter: float = 0.0


def grid() -> Array:
    """Inner corners of the chessboard, row by row, (n, 3), m."""
    return corners(SQUARES[0] - 1, SQUARES[1] - 1, PITCH)


def grown(uv: Array) -> float:
    """Noise of a detector over that of large squares: of so many pixels across as they look."""
    flat = np.c_[grid()[:, :2] / PITCH, np.ones(len(uv))]
    sides = np.linalg.svd(np.linalg.lstsq(flat, uv, rcond=None)[0][:2], compute_uv=False)
    return float(np.hypot(1.0, 20.0 / sides[1]))


def measured(cell_path: Path, setup: Setup, truth: Truth, q: Array, names: Sequence[str]) -> str:
    """The table of a day at the poses q (m, dof), rad: what each camera sees of each board whole."""
    robot: Robot = load_cell(cell_path).robot
    rng, placing = np.random.default_rng(truth.seed), np.random.default_rng(truth.stands)
    off = truth.moved[0] * np.array([1, 1, 1, 0, 0, 0]) + truth.moved[1] * np.array(
        [0, 0, 0, 1, 1, 1]
    )
    true = {
        name: s.frame() @ frame(off * placing.uniform(-1, 1, 6))
        for name, s in (*setup.cameras.items(), *setup.boards.items())
    }
    joints = [f"{joint}_rad" for joint in robot.joints]
    read = ["u_px", "v_px", *(["x_mm", "y_mm", "z_mm"] if setup.tracker else [])]
    empty = ",,," if setup.tracker else ""
    lines = [",".join(["pose", "instrument", "marker", *joints, *read])]
    points = grid() * truth.size
    station = frame(np.array([-3.0, -1.0, -1.0, 0.3, -0.2, 0.5]))
    true_q = q + truth.offsets + truth.scatter * rng.normal(size=q.shape)
    for name, own, tip in zip(names, q, tips(robot, true_q), strict=True):
        shared = ",".join(f"{value:.9f}" for value in own)
        for camera, s in setup.cameras.items():
            sigma_px = SIGMA_PX * truth.scales.get(camera, 1.0)
            eye = np.linalg.inv(tip @ true[camera] if s.on == "tip" else true[camera])
            for board, b in setup.boards.items():
                if b.on == s.on:
                    continue
                T = eye @ (tip @ true[board] if b.on == "tip" else true[board])
                if T[2, 3] < 0.05 or T[:3, 2] @ T[:3, 3] < 0.5 * np.linalg.norm(T[:3, 3]):
                    continue  # behind the camera, or seen from behind or from too far aside
                uv = pixels(points, T, truth.lens[:2], truth.lens[2:4], truth.lens[4:])
                sigma = sigma_px * (grown(uv) if truth.grows else 1.0)
                uv = uv + rng.normal(0.0, sigma, (len(points), 2))
                if (uv < 0.0).any() or (uv > np.array(IMAGE) - 1.0).any():
                    continue
                lines += [
                    f"{name},{camera},{board}:{k},{shared},{u:.4f},{v:.4f}{empty}"
                    for k, (u, v) in enumerate(uv)
                ]
        if setup.tracker:
            sigma_m = SIGMA_M * truth.scales.get("tracker", 1.0)
            seen = MARKERS @ tip[:3, :3].T + tip[:3, 3] @ np.eye(3)
            seen = seen @ station[:3, :3].T + station[:3, 3] + sigma_m * rng.normal(size=(3, 3))
            lines += [
                f"{name},tracker,m{k},{shared},,,{x:.5f},{y:.5f},{z:.5f}"
                for k, (x, y, z) in enumerate(1e3 * seen, 1)
            ]
    return "\n".join([*lines, ""])


def kr270_day(
    folder: Path, setup: Setup, truth: Truth, count: int = 40, again: int = 0,
    effects: str = '"base", "tool", "geometry"', more: str = "",
) -> tuple[Cell, Measurements]:  # fmt: skip
    """A day of a KR 270 at poses that show the boards; the first ``again`` are visited twice more."""
    (folder / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    path = folder / "cell.toml"
    path.write_text(setup.text("kr270.urdf", "base_link", "tool0", effects, more))
    cell = load_cell(path)
    q = poses_that_show(cell, np.random.default_rng([truth.seed, 7]), 60 * count, count)
    names = [f"p{k:02d}" for k in range(count)]
    if again:
        half = count // 2
        q = np.concatenate([q[:half], q[:again], q[half:], q[:again]])
        names = [f"p{k:02d}" for k in range(len(q))]
    table = folder / "measurements.csv"
    table.write_text(measured(path, setup, truth, q, names))
    return cell, load_measurements(cell, table)
