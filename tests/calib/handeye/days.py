"""Days of hand-eye calibrations on a KR 270, by plain numpy and OpenCV's projection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import calib
from calib.arrays import Array
from calib.poses import Measurements, poses_at
from studies.research.cameras import pixels
from tests.camera_cells import LENS, board_text, camera_text, kr270_cell
from tests.helpers import all_seen
from tests.plain_arm import frame, looking, tips

Kind = Literal["camera in hand", "camera on base", "poses"]
HOME = np.radians([10.0, -60.0, 80.0, 15.0, 40.0, 20.0])
PIXELS = np.array([1920.0, 1080.0])
TILES = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) * 0.06
OFF = np.array([0.0, 8e-4, -6e-4, 9e-4, 1.1e-3, 0.0])  # rad, of a true arm's joints
IN_HAND = frame(np.array([0.06, -0.03, 0.1, 0.2, -0.3, 0.9]))
POSE_SIGMA = np.repeat([4e-4, 8e-4], 3)  # m, rad
SIGMA_PX = 0.2
POSES = (
    '[bodies.cam]\n[instruments.board]\nkind = "pose"\n'
    f"sigma_mm = {1e3 * POSE_SIGMA[0]}\nsigma_urad = {1e6 * POSE_SIGMA[3]}\n"
)


@dataclass(frozen=True)
class Day:
    """A cell, what is read, and where the camera truly is: E, shape (4, 4)."""

    cell: calib.Cell
    data: Measurements
    E: Array


@dataclass(frozen=True)
class Arm:
    """A cell and a true arm, whose joints are off by (6,), rad."""

    cell: calib.Cell
    kind: Kind
    off: Array

    @classmethod
    def of(
        cls,
        folder: Path,
        kind: Kind,
        off: Array | float = 0.0,
        effects: Sequence[str] = ("base", "tool", "geometry"),
    ) -> Arm:
        """Write the cell into a folder, and read it."""
        on = {"camera in hand": ("world", "tip"), "camera on base": ("tip", "world")}
        tables = [POSES]
        if kind != "poses":
            board, camera = on[kind]
            tables = [board_text("b", board, TILES), camera_text("cam", camera)]
        cell = calib.load_cell(kr270_cell(folder, *tables, effects=effects))
        return cls(cell, kind, off * np.ones(6) if np.ndim(off) == 0 else np.asarray(off))

    @property
    def places(self) -> tuple[Array, Array]:
        """E and W: the camera on its carrier, the target on the other one."""
        tip = tips(self.cell.robot, HOME[None])[0]
        ahead = frame(np.array([-0.12, -0.09, 1.0, 0.3, -0.25, 0.1]))
        if self.kind == "camera on base":
            W = frame(np.array([-0.1, -0.1, 0.12, 0.3, 0.2, -0.4]))
            middle = (tip @ W @ [*TILES.mean(axis=0), 1.0])[:3]
            facing = (tip @ W)[:3, 2]
            return looking(middle, middle - 1.5 * facing + [0.2, 0.1, -0.1]), W
        return IN_HAND, tip @ IN_HAND @ ahead

    def seen(self, q: Array) -> Array:
        """C, shape (m, 4, 4): the target in the true camera."""
        E, W = self.places
        tip = tips(self.cell.robot, q + self.off)
        F = np.linalg.inv(tip) if self.kind == "camera on base" else tip
        return np.asarray(np.linalg.inv(F @ E) @ W)

    def day(self, count: int, seed: int | Sequence[int], noise: float = 1.0) -> Day:
        """So many images about the home pose; noise : times that of the cell."""
        rng = np.random.default_rng(seed)
        E, _ = self.places
        found: list[tuple[Array, Array]] = []
        while len(found) < count:
            q = HOME + rng.uniform(-0.3, 0.3, (4 * count, 6))
            rows, inside = self._read(self.seen(q), noise, rng)
            found += [(own, row) for own, row, good in zip(q, rows, inside, strict=True) if good]
        q, rows = (np.array(part) for part in zip(*found[:count], strict=True))
        return Day(self.cell, all_seen(poses_at(q), rows), E)

    def _read(self, C: Array, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
        if self.kind == "poses":
            errors = noise * POSE_SIGMA * rng.normal(size=(len(C), 6))
            T = np.array(
                [np.linalg.inv(one) @ frame(xi) for one, xi in zip(C, errors, strict=True)]
            )
            rows = np.concatenate([T[:, :3, 3], T[:, :3, 0], T[:, :3, 1]], axis=1)[:, None]
            return rows, np.ones(len(C), dtype=bool)
        points = TILES @ np.swapaxes(C[:, :3, :3], -1, -2) + C[:, None, :3, 3]
        uv = np.array([seen_by_opencv(T) for T in C])
        inside = ((uv > 0.0) & (uv < PIXELS)).all(axis=(1, 2))
        inside &= (points[..., 2] > 0.2).all(axis=1) & (C[:, 2, 2] > 0.5)
        return uv + noise * SIGMA_PX * rng.normal(size=uv.shape), inside


def seen_by_opencv(T: Array) -> Array:
    """Pixels (n, 2) of the board at T in camera axes."""
    return pixels(TILES, T, LENS[:2], LENS[2:4], LENS[4:])
