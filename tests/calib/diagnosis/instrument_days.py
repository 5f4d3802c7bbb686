"""Days with cameras, sockets, wires, gauges and bodies on a KR 270, with any fault of theirs.

The truth is plain numpy and OpenCV's projection: it shares no code with the estimator.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from studies.research.cameras import pixels
from tests.camera_cells import LENS, board_text, camera_text, kr270_cell
from tests.plain_arm import frame, looking, tips

JOINTS = ("A1", "A2", "A3", "A4", "A5", "A6")
OFF = np.array([0.0, 8e-4, -6e-4, 0.0, 1.1e-3, 0.0])  # rad, of the true arm's joints
HOME = np.radians([10.0, -60.0, 80.0, 15.0, 40.0, 20.0])
PIXELS = np.array([1920.0, 1080.0])
TILES = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) * 0.06
BALL = np.array([0.12, -0.05, 0.2])
CENTRES = np.array([[2.0, 0.3, 1.1], [2.1, -0.4, 1.0], [1.9, -0.1, 1.4], [2.2, 0.1, 0.9]])
SITES = ("nest", "cup", "cone", "rim")
SIGMA_PX, SIGMA_MM = 0.2, 0.05


@dataclass(frozen=True)
class Fault:
    """What is wrong on a day; by itself nothing.

    focal : float, share by which the focal length is larger than stated
    pitch : float, the same of the board
    camera, board : 6 numbers, m and rad, by which they are moved at noon, in their own axes
    socket : 3 numbers, m, by which ``cup`` is moved at noon
    zero : float, m, by which a wire or a gauge reads more from noon
    """

    focal: float = 0.0
    pitch: float = 0.0
    camera: tuple[float, ...] = (0.0,) * 6
    board: tuple[float, ...] = (0.0,) * 6
    socket: tuple[float, ...] = (0.0,) * 3
    zero: float = 0.0

    def added(self, count: int) -> Array:
        """What a wire or a gauge reads beyond what is there, m."""
        return self.zero * after_noon(count)


def seen_from_the_world(folder: Path, fault: Fault, seed: int, count: int = 45) -> Day:
    """A camera on a tripod looks at a board on the tip."""
    cell = written(folder, looked_at("tip", "world"), ball=False)
    rng, q = np.random.default_rng(seed), spread(seed, count)
    T, noon = tips(cell.robot, q + OFF), after_noon(count)
    stands = looking(T[:, :3, 3].mean(axis=0), np.array([3.6, -1.2, 2.2]))
    camera = both(stands, fault.camera, noon)
    board = T @ both(frame(np.array([0.05, -0.1, 0.2, 0.4, 2.0, -0.3])), fault.board, noon)
    return read(cell, folder, q, camera, board, fault, rng)


def seen_from_the_tip(folder: Path, fault: Fault, seed: int, count: int = 45) -> Day:
    """A camera on the tip looks at a board on the floor."""
    cell = written(folder, looked_at("world", "tip"), ball=False)
    rng, q = np.random.default_rng(seed), spread(seed, count, 0.3)
    T, noon = tips(cell.robot, q + OFF), after_noon(count)
    eye = frame(np.array([0.05, 0.08, 0.1, 0.1, -0.2, 0.5]))
    ahead = frame(np.array([-0.15, -0.1, 1.3, 0.3, 0.2, -0.4]))
    floor = tips(cell.robot, HOME[None])[0] @ eye @ ahead
    camera = T @ both(eye, fault.camera, noon)
    return read(cell, folder, q, camera, both(floor, fault.board, noon), fault, rng)


Day = tuple[Cell, Measurements]


def both(T: Array, moved: tuple[float, ...], after: Array) -> Array:
    """A frame before and after it is moved, (m, 4, 4)."""
    return np.where(after[:, None, None], T @ frame(np.array(moved)), T)


def along_a_wire(folder: Path, fault: Fault, seed: int, count: int = 60) -> Day:
    """A draw-wire from a drum on the floor to a ball on the tip."""
    cell = written(folder, f'[instruments.wire]\nkind = "distance"\nsigma_mm = {SIGMA_MM}\n')
    rng, q = np.random.default_rng(seed), spread(seed, count)
    T = tips(cell.robot, q + OFF)
    ball = T[:, :3, :3] @ BALL + T[:, :3, 3]
    d = np.linalg.norm(ball - np.array([1.4, 0.9, 0.1]), axis=1)
    d = d + fault.added(count) + rng.normal(scale=SIGMA_MM * 1e-3, size=count)
    rows: list[list[object]] = [[i, "wire", "ball", f"{1e3 * x:.6f}"] for i, x in enumerate(d)]
    return cell, tabled(cell, folder, q, rows, ["d_mm"])


def on_a_table(folder: Path, fault: Fault, seed: int, count: int = 60) -> Day:
    """A dial gauge's ball reads how high it stands over a table that leans a little."""
    cell = written(folder, f'[instruments.table]\nkind = "plane"\nsigma_mm = {SIGMA_MM}\n')
    rng, q = np.random.default_rng(seed), spread(seed, count)
    T = tips(cell.robot, q + OFF)
    ball = T[:, :3, :3] @ BALL + T[:, :3, 3]
    normal = np.array([0.05, -0.08, 1.0])
    d = ball @ normal / np.linalg.norm(normal) - 0.9
    d = d + fault.added(count) + rng.normal(scale=SIGMA_MM * 1e-3, size=count)
    rows: list[list[object]] = [[i, "table", "ball", f"{1e3 * x:.6f}"] for i, x in enumerate(d)]
    return cell, tabled(cell, folder, q, rows, ["d_mm"])


def with_a_body(folder: Path, fault: Fault, seed: int, count: int = 45) -> Day:
    """A 6-D tracker on a tripod reads a body on the tip, and a wire the ball beside it."""
    wire = f'[instruments.wire]\nkind = "distance"\nsigma_mm = {SIGMA_MM}\n'
    mocap = f'[instruments.mocap]\nkind = "pose"\nsigma_mm = {SIGMA_MM}\nsigma_urad = 50\n'
    cell = written(folder, "[bodies.plate]\n" + mocap + wire)
    rng, q = np.random.default_rng(seed), spread(seed, count)
    T, stands = tips(cell.robot, q + OFF), frame(np.array([2.5, -1.0, 0.4, 0.3, -0.2, 2.0]))
    ball = T[:, :3, :3] @ BALL + T[:, :3, 3]
    d = np.linalg.norm(ball - np.array([1.4, 0.9, 0.1]), axis=1)
    d = d + rng.normal(scale=SIGMA_MM * 1e-3, size=count)
    stands = both(stands, fault.camera, after_noon(count))
    body = T @ frame(np.array([0.05, -0.1, 0.2, 0.4, 2.0, -0.3]))
    rows: list[list[object]] = []
    for i in range(count):
        error = np.concatenate([SIGMA_MM * 1e-3 * rng.normal(size=3), 5e-5 * rng.normal(size=3)])
        there = np.linalg.inv(stands[i]) @ body[i] @ frame(error)
        x, y, z, w = Rotation.from_matrix(there[:3, :3]).as_quat()
        read = [*(f"{1e3 * a:.6f}" for a in there[:3, 3]), *(f"{a:.9f}" for a in (w, x, y, z))]
        rows += [
            [i, "mocap", "plate", *read, ""],
            [i, "wire", "ball", *[""] * 7, f"{1e3 * d[i]:.6f}"],
        ]
    columns = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "d_mm"]
    return cell, tabled(cell, folder, q, rows, columns)


def spread(seed: int, count: int, width: float = 0.5) -> Array:
    return HOME + np.random.default_rng(1000 + seed).uniform(-width, width, (count, 6))


def after_noon(count: int) -> Array:
    return np.arange(count) >= 0.55 * count


def hours(count: int) -> Array:
    return np.arange(count) * 0.1


def degrees(count: int) -> Array:
    """Temperature, which falls again while time goes on."""
    return 22.0 + 4.0 * np.sin(1.7 * hours(count))


def read(
    cell: Cell,
    folder: Path,
    q: Array,
    camera: Array,
    board: Array,
    fault: Fault,
    rng: np.random.Generator,
) -> Day:
    """What a camera at frames (m, 4, 4) in base axes sees of a board at others."""
    rows, count = [], len(q)
    for i in range(count):
        there = TILES * (1.0 + fault.pitch) @ board[i, :3, :3].T + board[i, :3, 3]
        own = (there - camera[i, :3, 3]) @ camera[i, :3, :3]
        uv = pixels(own, np.eye(4), LENS[:2] * (1.0 + fault.focal), LENS[2:4], LENS[4:])
        uv = uv + rng.normal(scale=SIGMA_PX, size=uv.shape)
        inside = ((uv > 0.0) & (uv < PIXELS)).all(axis=1) & (own[:, 2] > 0.1)
        for k in np.flatnonzero(inside):
            rows.append([i, "eye", f"plate:p{k}", *(f"{x:.6f}" for x in uv[k])])
    return cell, tabled(cell, folder, q, rows, ["u_px", "v_px"])


def in_sockets(folder: Path, fault: Fault, seed: int, count: int = 72) -> Day:
    """A ball on the tip is put into four sockets; the arm gives way to them."""
    sockets = (f'[instruments.{s}]\nkind = "socket"\nsigma_mm = {SIGMA_MM}\n' for s in SITES)
    cell = written(folder, "".join(sockets))
    rng, robot = np.random.default_rng(seed), cell.robot
    site, noon = np.arange(count) % 4, after_noon(count)
    goal = CENTRES[site] + np.where((noon & (site == 1))[:, None], np.array(fault.socket), 0.0)
    goal = goal + rng.normal(scale=SIGMA_MM * 1e-3, size=goal.shape)
    q = spread(seed, count, 0.7)

    def off(q: Array) -> Array:
        T = tips(robot, q + OFF)
        return goal - (T[:, :3, :3] @ BALL + T[:, :3, 3])

    for _ in range(12):
        ends = [off(q - h) - off(q + h) for h in 1e-6 * np.eye(6)]
        step = np.einsum("mjr,mr->mj", np.linalg.pinv(np.stack(ends, axis=-1) / 2e-6), off(q))
        q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
    there = np.linalg.norm(off(q), axis=1) < 1e-8
    rows = [[i, SITES[site[i]], "ball"] for i in np.flatnonzero(there)]
    return cell, tabled(cell, folder, q, rows, [])


def tabled(
    cell: Cell, folder: Path, q: Array, rows: list[list[object]], columns: list[str]
) -> Measurements:
    """Rows of pose, instrument, marker and numbers, through a table."""
    time, heat = 3600.0 * hours(len(q)), degrees(len(q))
    path = folder / "measurements.csv"
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        joints = [f"{joint}_deg" for joint in JOINTS]
        head = ["pose", "instrument", "marker", *joints, "time_s", "temperature_degC"]
        out.writerow([*head, *columns])
        for i, instrument, marker, *numbers in rows:
            angles = [f"{x:.12g}" for x in np.degrees(q[i])]
            known = [f"{time[i]:.1f}", f"{heat[i]:.4f}"]
            out.writerow([f"p{i:03d}", instrument, marker, *angles, *known, *numbers])
    return calib.load_measurements(cell, path)


def written(folder: Path, instruments: str, ball: bool = True) -> Cell:
    """A cell with instruments, and with a ball on the tip where they are said to read one."""
    marker = f"[markers_mm]\nball = {(1e3 * BALL + 4.0).tolist()}\n" if ball else ""
    effects = ("base", "tool", "joint_offset:A2,A3,A5")
    return calib.load_cell(kr270_cell(folder, instruments, marker, effects=effects))


def looked_at(board: str, camera: str) -> str:
    """A board and a camera, where they are said to be."""
    return board_text("plate", board, TILES) + camera_text("eye", camera)
