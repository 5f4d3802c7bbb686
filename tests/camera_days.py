"""Days with cameras: cells of every set-up, and what is read there, by OpenCV's ``projectPoints``.

The arm is composed link by link in :mod:`tests.plain_arm`; nothing here knows how posecal projects.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from calib import Cell, Measurements, load_cell, load_measurements
from calib.arrays import Array
from doe.constraints import scene_of, visible
from doe.views import NUMBERS, looking, views_of
from tests.camera_cells import kr270_cell
from tests.plain_arm import frame, tips

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
IMAGE = (1280, 960)
LENS = np.array([1000.0, 1000.0, 639.5, 479.5, 0.0, 0.0, 0.0, 0.0, 0.0])
SIGMA_PX, SIGMA_M = 0.1, 2e-5
SQUARES, PITCH = (9, 6), 0.03
MARKERS = np.array([[0.05, 0.0, 0.03], [-0.03, 0.05, 0.03], [-0.03, -0.05, 0.03]])
STATION = frame(np.array([-3.0, -1.0, -1.0, 0.3, -0.2, 0.5]))  # base axes, in those of the tracker


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


# -- Cells


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

    def tables(self, more: str = "") -> Iterator[str]:
        """Those of its cell; more : keys of each camera."""
        if self.tracker:
            rows = (f"m{k} = {(1e3 * m).tolist()}\n" for k, m in enumerate(MARKERS, 1))
            yield "[markers_mm]\n" + "".join(rows)
            yield (
                f'[instruments.tracker]\nkind = "points"\nsigma_mm = {1e3 * SIGMA_M}\n'
                "position_mm = [3000, 1000, 1000]\n"
            )
        for name, stands in self.boards.items():
            printed = f"squares = {list(SQUARES)}\npitch_mm = {1e3 * PITCH}\n"
            yield f"[boards.{name}]\n{printed}{stands.keys()}"
        for name, stands in self.cameras.items():
            lens = f"focal_px = {LENS[0]}\ncenter_px = {LENS[2:4].tolist()}\nimage_px = {list(IMAGE)}\n"
            yield (
                f'[instruments.{name}]\nkind = "camera"\nsigma_px = {SIGMA_PX}\n{lens}'
                f"{stands.keys()}{more}"
            )


HAND = {"cam": Stands("tip", [60, 0, 80], [0, 0, 90])}
TABLE = {"table": Stands("world", [1500, -100, 300], [180, 0, 0])}
PAIR = {
    "left": Stands("world", [3200, 700, 1800], [-90, 0, 105]),
    "right": Stands("world", [3200, -700, 1800], [-90, 0, 75]),
}
SETUPS = {
    "kr270": Setup(HAND, TABLE, tracker=True),
    "kr270, hand": Setup(HAND, TABLE),
    "kr270, two": Setup(PAIR, {"plate": Stands("tip", [100, -130, -90], [0, 180, 0])}),
}


# -- Days


@dataclass(frozen=True, eq=False)
class Truth:
    """How the day differs from its cell.

    offsets : of the joints, rad; lens : of every camera, as OpenCV writes it, px
    moved : how far cameras and boards are from where the cell says, (m, rad)
    seed : of the noise; scales : times the stated noise, of each instrument by its name
    grows : whether noise of an image grows as squares look smaller, else it is the same in all
    scatter : rad, of every joint anew at every stop
    """

    offsets: Array
    lens: Array = field(default_factory=LENS.copy)
    moved: tuple[float, float] = (0.01, 0.02)
    seed: int = 0
    scales: Mapping[str, float] = field(default_factory=dict)
    grows: bool = True
    scatter: float = 0.0

    def noise(self, instrument: str) -> float:
        """px of a camera, m of the tracker."""
        stated = SIGMA_M if instrument == "tracker" else SIGMA_PX
        return stated * self.scales.get(instrument, 1.0)


GRID = corners(SQUARES[0] - 1, SQUARES[1] - 1, PITCH)


def grown(uv: Array) -> float:
    """Noise of a detector over that of large squares: of so many pixels across as they look."""
    flat = np.c_[GRID[:, :2] / PITCH, np.ones(len(uv))]
    sides = np.linalg.svd(np.linalg.lstsq(flat, uv, rcond=None)[0][:2], compute_uv=False)
    return float(np.hypot(1.0, 20.0 / sides[1]))


def poses_that_show(cell: Cell, rng: np.random.Generator, count: int) -> Array:
    """Joint values (count, dof), rad, at which all that cameras look at is seen."""
    low, high = cell.robot.sample_limits().T
    drawn, free = 60 * count, np.ones(cell.robot.dof, dtype=bool)
    q, even = rng.uniform(low, high, (drawn, cell.robot.dof)), rng.uniform(size=(drawn, NUMBERS))
    view, found = np.arange(drawn) % len(views_of(cell)), q[:0]
    for part in np.split(np.arange(drawn), range(250, drawn, 250)):
        there = looking(cell, q[part], view[part], even[part], free)
        found = np.concatenate([found, there[visible(scene_of(cell, there)).all(axis=1)]])
        if len(found) >= count:
            break
    return found[:count]


def measured(cell: Cell, setup: Setup, truth: Truth, q: Array) -> str:
    """The table of a day at the poses q (m, dof), rad: what each camera sees of each board whole."""
    rng, placing = np.random.default_rng(truth.seed), np.random.default_rng(0)
    off = np.repeat(truth.moved, 3)
    true = {
        name: stands.frame() @ frame(off * placing.uniform(-1, 1, 6))
        for name, stands in (*setup.cameras.items(), *setup.boards.items())
    }
    joints = [f"{joint}_rad" for joint in cell.robot.joints]
    read = ["u_px", "v_px", *(["x_mm", "y_mm", "z_mm"] if setup.tracker else [])]
    empty = ",,," if setup.tracker else ""
    lines = [",".join(["pose", "instrument", "marker", *joints, *read])]
    true_q = q + truth.offsets + truth.scatter * rng.normal(size=q.shape)
    for i, (own, tip) in enumerate(zip(q, tips(cell.robot, true_q), strict=True)):
        shared = ",".join(f"{value:.9f}" for value in own)
        carried = {"tip": tip, "world": np.eye(4)}
        for camera, s in setup.cameras.items():
            eye = np.linalg.inv(carried[s.on] @ true[camera])
            for board, b in setup.boards.items():
                T = eye @ carried[b.on] @ true[board]
                if T[2, 3] < 0.05 or T[:3, 2] @ T[:3, 3] < 0.5 * np.linalg.norm(T[:3, 3]):
                    continue  # behind the camera, or seen from behind or from too far aside
                uv = pixels(GRID, T, truth.lens[:2], truth.lens[2:4], truth.lens[4:])
                sigma = truth.noise(camera) * (grown(uv) if truth.grows else 1.0)
                uv = uv + rng.normal(0.0, sigma, uv.shape)
                if (uv < 0.0).any() or (uv > np.array(IMAGE) - 1.0).any():
                    continue
                lines += [
                    f"p{i:02d},{camera},{board}:{k},{shared},{u:.4f},{v:.4f}{empty}"
                    for k, (u, v) in enumerate(uv)
                ]
        if setup.tracker:
            seen = MARKERS @ (STATION @ tip)[:3, :3].T + (STATION @ tip)[:3, 3]
            seen = seen + truth.noise("tracker") * rng.normal(size=(3, 3))
            lines += [
                f"p{i:02d},tracker,m{k},{shared},,,{x:.5f},{y:.5f},{z:.5f}"
                for k, (x, y, z) in enumerate(1e3 * seen, 1)
            ]
    return "\n".join([*lines, ""])


def kr270_day(
    folder: Path, setup: Setup, truth: Truth, count: int = 40, again: int = 0,
    effects: str = '"base", "tool", "geometry"', more: str = "",
) -> tuple[Cell, Measurements]:  # fmt: skip
    """A day of a KR 270 at poses that show the boards; the first ``again`` are visited twice more."""
    tables = setup.tables(more)
    cell = load_cell(kr270_cell(folder, *tables, effects=json.loads(f"[{effects}]")))
    q = poses_that_show(cell, np.random.default_rng([truth.seed, 7]), count)
    half = count // 2
    q = np.concatenate([q[:half], q[:again], q[half:], q[:again]])
    table = folder / "measurements.csv"
    table.write_text(measured(cell, setup, truth, q))
    return cell, load_measurements(cell, table)
