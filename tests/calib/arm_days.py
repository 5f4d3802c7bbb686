"""Days of measurement in MuJoCo, written as the files of a user who made a mistake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib import Cell, Measurements
from calib.arrays import Array
from studies.research.truth.arms import HEAVY, Arm, Joint
from studies.research.truth.mechanism import Mechanism, urdf

_TURN = (-2.8, 2.8)


def _turning(name: str, z: float, axis: tuple[float, float, float], x: float = 0.0) -> Joint:
    return Joint(name, (x, 0, z), axis, *_TURN, mass=1.0, com=(0, 0, 0))


_REST = {"sigma": 1e-5, "load": 0.0, "tool": 0.1, "largest": 1e-3, "payload": 0.0}
SCARA = Arm(
    "scara",
    "base",
    "tool",
    (
        _turning("J1", 0.2, (0, 0, 1)),
        _turning("J2", 0.05, (0, 0, 1), 0.325),
        Joint("Z", (0.275, 0, 0), (0, 0, -1), 0.0, 0.2, 1.0, (0, 0, 0), slides=True),
        _turning("R", -0.1, (0, 0, -1)),
    ),
    (0, 0, -0.05),
    (0, 0, 0),
    **_REST,
)
SEVEN = Arm(
    "seven",
    "base",
    "flange",
    tuple(
        _turning(f"A{k}", z, axis)
        for k, (z, axis) in enumerate(
            zip(
                (0.16, 0.18, 0.2, 0.2, 0.2, 0.2, 0.09),
                ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)),
                strict=True,
            ),
            1,
        )
    ),
    (0, 0, 0.045),
    (0, 0, 0),
    **_REST,
)
MARKERS = np.array([[0.07, -0.02, 0.05], [-0.05, 0.06, 0.03], [-0.02, -0.08, 0.09]])


@dataclass(frozen=True, eq=False)
class Day:
    """What the user's files hold: joints (m, n) and points (m, M, 3) as columns, SI until a mistake.

    units : of the columns of angles, slides, points; effects : the model
    place : R (3, 3) and p (3,), m, of the base in the instrument's frame
    """

    arm: Arm
    q: Array
    points: Array
    units: tuple[str, str, str] = ("deg", "mm", "mm")
    effects: tuple[str, ...] = ("base", "tool", "geometry")
    markers: Array = field(default_factory=MARKERS.copy)
    place: tuple[Array, Array] = (np.eye(3), np.zeros(3))

    def written(self, folder: Path) -> Path:
        """Cell, robot and table in a folder."""
        shown = ", ".join(f'"{effect}"' for effect in self.effects)
        places = "\n".join(f"m{j} = {(p * 1e3).tolist()}" for j, p in enumerate(self.markers, 1))
        (folder / "robot.urdf").write_text(urdf(self.arm, masses=False))
        (folder / "cell.toml").write_text(
            f'schema = 1\nname = "day"\n[robot]\nurdf = "robot.urdf"\nbase = "{self.arm.base}"\n'
            f'tip = "{self.arm.tip}"\n[markers_mm]\n{places}\n[instrument]\nsigma_mm = 0.02\n'
            f"[model]\neffects = [{shown}]\n"
        )
        turn, slide, point = self.units
        columns = [f"{j.name}_{slide if j.slides else turn}" for j in self.arm.joints]
        scale = {"deg": 180.0 / np.pi, "rad": 1.0, "mm": 1e3, "m": 1.0}
        q = self.q * [scale[column.rpartition("_")[2]] for column in columns]
        lines = [",".join(["pose", "marker", *columns, *(f"{a}_{point}" for a in "xyz")])]
        for i, joints in enumerate(q):
            for j, p in enumerate(self.points[i] * scale[point], 1):
                values = ",".join(f"{v:.9f}" for v in (*joints, *p))
                lines.append(f"p{i:03d},m{j},{values}")
        (folder / "measurements.csv").write_text("\n".join([*lines, ""]))
        return folder

    def read(self, folder: Path) -> tuple[Cell, Measurements]:
        """The files as the program reads them."""
        cell = calib.load_cell(self.written(folder) / "cell.toml")
        return cell, calib.load_measurements(cell, folder / "measurements.csv")

    def with_points(self, change: Callable[[Array], Array]) -> Day:
        return replace(self, points=change(self.points))

    def with_joints(self, change: Callable[[Array], Array]) -> Day:
        return replace(self, q=change(self.q))


def day(
    arm: Arm = HEAVY, seed: int = 0, poses: int = 50, markers: int = 3, link: float = 0.0
) -> Day:
    """An arm with errors of 0.3 mm and 0.4 mrad at every frame, read to 0.02 mm from anywhere.

    link : m, by which one link is longer than its model
    """
    rng = np.random.default_rng(seed)
    geometry = rng.normal(size=(arm.dof + 2, 6)) * np.repeat([3e-4, 4e-4], 3)
    along = rng.normal(size=3)
    geometry[rng.integers(2, arm.dof + 1), :3] += link * along / np.linalg.norm(along)
    low, high = arm.limits.T
    q = rng.uniform(low, high, (poses, arm.dof))
    true = MARKERS[:markers] + rng.normal(size=(markers, 3)) * 3e-3
    points = Mechanism(arm, geometry, true, weighs=False).posed(q).points
    R = Rotation.random(random_state=rng).as_matrix()
    p = rng.uniform(-3.0, 3.0, 3)
    points = points @ R.T + p + rng.normal(size=points.shape) * 2e-5
    return Day(arm, q, points, markers=MARKERS[:markers], place=(R, p))
