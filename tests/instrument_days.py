"""Days with cameras, sockets, wires, gauges and bodies on a KR 270, with any fault of theirs.

The truth is plain numpy and OpenCV's projection: it shares no code with the estimator.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from tests.camera_cells import LENS, board_text, camera_text, kr270_cell
from tests.camera_days import pixels
from tests.day import Day, Sizes
from tests.plain_arm import frame, looking, tips
from tests.touched_arm import led_to

OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])  # rad, of the true arm's joints
EFFECTS = ("base", "tool", "joint_offset:A2,A3,A5")
HOME = np.radians([10.0, -60.0, 80.0, 15.0, 40.0, 20.0])
PIXELS = np.array([1920.0, 1080.0])
TILES = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) * 0.06
BALL = np.array([0.12, -0.05, 0.2])
PLATE = frame(np.array([0.05, -0.1, 0.2, 0.4, 2.0, -0.3]))  # of a board or a body on the tip
EYE = frame(np.array([0.05, 0.08, 0.1, 0.1, -0.2, 0.5]))  # of a camera on the tip
AHEAD = frame(np.array([-0.15, -0.1, 1.3, 0.3, 0.2, -0.4]))  # of what that looks at
CENTRES = np.array([[2.0, 0.3, 1.1], [2.1, -0.4, 1.0], [1.9, -0.1, 1.4], [2.2, 0.1, 0.9]])
SITES = ("nest", "cup", "cone", "rim")
SIGMA_PX, SIGMA_MM = 0.2, 0.05

Rows = Iterable[tuple[object, ...]]
"""Pose, instrument, marker, and numbers."""


# -- What an instrument sees


def spread(seed: int, count: int, width: float = 0.5) -> Array:
    return HOME + np.random.default_rng(1000 + seed).uniform(-width, width, (count, 6))


def true_tips(cell: Cell, q: Array) -> Array:
    """Of the true arm, whose joints are off."""
    return tips(cell.robot, q + OFF)


def projected(points: Array, lens: Array = LENS) -> Array:
    """Pixels (..., 2) of points (..., 3), camera axes, by OpenCV."""
    found = pixels(points.reshape(-1, 3), np.eye(4), lens[:2], lens[2:4], lens[4:])
    return found.reshape((*points.shape[:-1], 2))


def sights(
    camera: str, board: str, points: Array, T_board: Array, T_camera: Array,
    rng: np.random.Generator | None = None, lens: Array = LENS,
) -> list[tuple[object, ...]]:  # fmt: skip
    """What a camera sees of a board, frames in base axes, one or one a pose; rng : of the noise."""
    world = points @ np.swapaxes(T_board[..., :3, :3], -1, -2) + T_board[..., None, :3, 3]
    own = (world - T_camera[..., None, :3, 3]) @ T_camera[..., :3, :3]
    uv = projected(own, lens)
    if rng is not None:
        uv = uv + rng.normal(scale=SIGMA_PX, size=uv.shape)
    inside = ((uv > 0.0) & (uv < PIXELS)).all(axis=-1) & (own[..., 2] > 0.1)
    return [(i, camera, f"{board}:p{k}", *uv[i, k]) for i, k in np.argwhere(inside).tolist()]


def tabled(
    cell: Cell, q: Array, rows: Rows, columns: tuple[str, ...] = ("u_px", "v_px")
) -> Measurements:
    """Rows through a table, with the time and a temperature that falls again while time goes on."""
    time = 360.0 * np.arange(len(q))
    heat = 22.0 + 4.0 * np.sin(1.7 * time / 3600.0)
    path = cell.path.with_name("measurements.csv")
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        joints = [f"{joint}_deg" for joint in cell.robot.joints]
        head = ["pose", "instrument", "marker", *joints, "time_s", "temperature_degC"]
        out.writerow([*head, *columns])
        for i, instrument, marker, *numbers in rows:
            angles = [f"{x:.12g}" for x in np.degrees(q[i])]
            known = [f"{time[i]:.1f}", f"{heat[i]:.4f}"]
            shown = [x if x == "" else f"{x:.10g}" for x in numbers]
            out.writerow([f"p{i:03d}", instrument, marker, *angles, *known, *shown])
    return calib.load_measurements(cell, path)


def written(folder: Path, *tables: str, ball: bool = True) -> Cell:
    """A cell with instruments, and with a ball on the tip where they read one."""
    marker = f"[markers_mm]\nball = {(1e3 * BALL + 4.0).tolist()}\n" if ball else ""
    return calib.load_cell(kr270_cell(folder, *tables, marker, effects=EFFECTS))


# -- Scenes, and what may be wrong there


@dataclass(frozen=True, eq=False)
class Fault:
    """What is wrong, from the start or from noon on; count : of the poses."""

    cause: str
    size: Sizes
    count: int

    def of(self, what: str, shape: tuple[int, ...] = ()) -> Array:
        """Its size where that is the cause, else nothing."""
        return np.array(self.size) if self.cause == what else np.zeros(shape)

    @property
    def after_noon(self) -> Array:
        return np.arange(self.count) >= 0.55 * self.count

    def moved(self, T: Array, what: str) -> Array:
        """A frame, at noon moved in its own axes by (m, rad) where that is the cause, (m, 4, 4)."""
        return np.where(self.after_noon[:, None, None], T @ frame(self.of(what, (6,))), T)


def photographed(on: str, folder: Path, cause: str, size: Sizes, seed: int) -> Day:
    """A camera on a tripod looks at a board on the tip, or one on the tip at a board on the floor.

    Focal length and pitch are larger than stated by a share where they are the cause.
    """
    fault, rng = Fault(cause, size, 45), np.random.default_rng(seed)
    other = {"world": "tip", "tip": "world"}[on]
    cell = written(folder, board_text("plate", other, TILES), camera_text("eye", on), ball=False)
    q = spread(seed, fault.count, 0.5 if on == "world" else 0.3)
    T = true_tips(cell, q)
    if on == "world":
        stands = looking(T[:, :3, 3].mean(axis=0), np.array([3.6, -1.2, 2.2]))
        camera, board = fault.moved(stands, "camera"), T @ fault.moved(PLATE, "board")
    else:
        floor = tips(cell.robot, HOME[None])[0] @ EYE @ AHEAD
        camera, board = T @ fault.moved(EYE, "camera"), fault.moved(floor, "board")
    points, lens = TILES * (1.0 + fault.of("pitch")), LENS.copy()
    lens[:2] *= 1.0 + fault.of("focal")
    data = tabled(cell, q, sights("eye", "plate", points, board, camera, rng, lens))
    return Day(cell, data, None, OFF)


def at_ball(T: Array) -> Array:
    return np.asarray(T[:, :3, :3] @ BALL + T[:, :3, 3])


def from_the_drum(ball: Array) -> Array:
    return np.asarray(np.linalg.norm(ball - np.array([1.4, 0.9, 0.1]), axis=1))


def over_the_table(ball: Array) -> Array:
    normal = np.array([0.05, -0.08, 1.0])  # it leans a little
    return np.asarray(ball @ normal / np.linalg.norm(normal) - 0.9)


# From a drum on the floor to the ball; how high the ball stands over a table.
LENGTHS = {"wire": ("distance", from_the_drum), "table": ("plane", over_the_table)}


def with_a_length(name: str, folder: Path, cause: str, size: Sizes, seed: int) -> Day:
    """One number a pose, of the ball; from noon a zero more where that is the cause."""
    kind, of = LENGTHS[name]
    cell = written(folder, f'[instruments.{name}]\nkind = "{kind}"\nsigma_mm = {SIGMA_MM}\n')
    fault, q, rng = Fault(cause, size, 60), spread(seed, 60), np.random.default_rng(seed)
    d = of(at_ball(true_tips(cell, q))) + rng.normal(scale=SIGMA_MM * 1e-3, size=len(q))
    d = d + fault.of("zero") * fault.after_noon
    data = tabled(cell, q, [(i, name, "ball", 1e3 * x) for i, x in enumerate(d)], ("d_mm",))
    return Day(cell, data, None, OFF)


def with_a_body(folder: Path, cause: str, size: Sizes, seed: int) -> Day:
    """A 6-D tracker on a tripod reads a body on the tip, and a wire the ball beside it."""
    wire = f'[instruments.wire]\nkind = "distance"\nsigma_mm = {SIGMA_MM}\n'
    mocap = f'[instruments.mocap]\nkind = "pose"\nsigma_mm = {SIGMA_MM}\nsigma_urad = 50\n'
    cell = written(folder, "[bodies.plate]\n", mocap, wire)
    q, rng = spread(seed, 45), np.random.default_rng(seed)
    T, stands = true_tips(cell, q), frame(np.array([2.5, -1.0, 0.4, 0.3, -0.2, 2.0]))
    d = from_the_drum(at_ball(T)) + rng.normal(scale=SIGMA_MM * 1e-3, size=len(q))
    error = rng.normal(size=(len(q), 6)) * np.repeat([SIGMA_MM * 1e-3, 5e-5], 3)
    stood = Fault(cause, size, len(q)).moved(stands, "camera")
    there = np.linalg.inv(stood) @ T @ PLATE @ frame(error)
    turns = Rotation.from_matrix(there[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
    rows: list[tuple[object, ...]] = []
    for i, (p, turn) in enumerate(zip(1e3 * there[:, :3, 3], turns, strict=True)):
        rows.append((i, "mocap", "plate", *p, *turn, ""))
        rows.append((i, "wire", "ball", *[""] * 7, 1e3 * d[i]))
    columns = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "d_mm")
    return Day(cell, tabled(cell, q, rows, columns), None, OFF)


def in_sockets(folder: Path, cause: str, size: Sizes, seed: int) -> Day:
    """A ball on the tip is put into four sockets; the arm gives way to them."""
    sockets = (f'[instruments.{s}]\nkind = "socket"\nsigma_mm = {SIGMA_MM}\n' for s in SITES)
    cell, rng = written(folder, *sockets), np.random.default_rng(seed)
    fault, site = Fault(cause, size, 72), np.arange(72) % 4
    goal = CENTRES[site] + np.outer(fault.after_noon & (site == 1), fault.of("socket", (3,)))
    goal = goal + rng.normal(scale=SIGMA_MM * 1e-3, size=goal.shape)
    q, there = led_to(spread(seed, 72, 0.7), lambda q: at_ball(true_tips(cell, q)), goal)
    rows = [(i, SITES[site[i]], "ball") for i in np.flatnonzero(there)]
    return Day(cell, tabled(cell, q, rows, ()), None, OFF)


SCENES: dict[str, Callable[[Path, str, Sizes, int], Day]] = {
    "camera in the world": partial(photographed, "world"),
    "camera on the tip": partial(photographed, "tip"),
    "wire": partial(with_a_length, "wire"),
    "gauge": partial(with_a_length, "table"),
    "6-D tracker": with_a_body,
    "sockets": in_sockets,
}
