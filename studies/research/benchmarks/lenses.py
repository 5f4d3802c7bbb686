"""Is it the camera, the board or the arm: what the diagnosis says of days whose error is known.

    python -m studies.research.benchmarks.lenses [--days 20] [--case A ..] [--workers 2]

A Panda with a camera on its hand looks at a chessboard of 8 x 11 corners, 45 poses a day. The arm is
read from its URDF and bent by payload and compliance in this file, pixels are OpenCV's
``projectPoints``: nothing of it is shared with posecal. The cell believes in the nominal lens and
board, and identifies base, tool and geometry. A: the lens is wrong in all its parts. B: two joints
have offsets, one is elastic.
C: both. D: the board is 0.2 % too large. E, F, G: focal length, principal point, k1 alone. N: nothing.

Right is a day whose causes lie on the side that errs, and on no other. ``aside`` counts causes on the
other side above a probability of 0.2; ``lens`` the shares of its values within two standard deviations.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from defusedxml import ElementTree

import calib
from calib.arrays import Array
from calib.cell.views import NUMBERS, looking
from doe.constraints import scene_of, visible
from studies.research.bench import Output, Row, bench, data_folder, each, several, table

_FOCAL, _CENTER, _NOISE = 900.0, (640.0, 480.0), 0.1  # px
_POSES, _DRAWN = 45, 4000
_PAYLOAD, _GRAVITY = 3.0, 9.81  # kg at the tip, m/s^2
_COMPLIANCE = 8e-5  # rad/(N m) of the fourth joint
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
position_mm = [500, -110, 0]
rpy_deg = [180, 0, 0]
[instruments.camera]
kind = "camera"
on = "tip"
focal_px = {focal}
center_px = {center}
image_px = [1280, 960]
sigma_px = {noise}
position_mm = [50, 0, 50]
rpy_deg = [0, 0, 90]
[model]
effects = ["base", "tool", "geometry"]
"""
# case -> (fx, fy) [share], (cx, cy) [px], k1, k2, offsets of joints 2 and 4 [rad], compliance, board
_LENS = ((0.006, 0.004), (3.5, -3.0), -0.03, 0.01)
_RIGHT = ((0.0, 0.0), (0.0, 0.0), 0.0, 0.0)
_CASES: dict[str, tuple[Any, float, float, frozenset[str]]] = {
    "A": (_LENS, 0.0, 1.0, frozenset({"camera"})),
    "B": (_RIGHT, 1.0, 1.0, frozenset({"arm"})),
    "C": (_LENS, 1.0, 1.0, frozenset({"camera", "arm"})),
    "D": (_RIGHT, 0.0, 1.002, frozenset({"board"})),
    "E": (((0.005, 0.005), (0.0, 0.0), 0.0, 0.0), 0.0, 1.0, frozenset({"camera"})),
    "F": (((0.0, 0.0), (2.0, 0.0), 0.0, 0.0), 0.0, 1.0, frozenset({"camera"})),
    "G": (((0.0, 0.0), (0.0, 0.0), -0.02, 0.0), 0.0, 1.0, frozenset({"camera"})),
    "N": (_RIGHT, 0.0, 1.0, frozenset()),
}
_UNLIKELY = 0.2


@bench(several("--case", sorted(_CASES)), days=20, days_help="Days of each case.", workers=True)
def main(case: Sequence[str], days: int, seed: int, workers: int) -> Output:
    """Camera, board or arm: how often the diagnosis is right."""
    tasks = [(name, seed + day) for name in case for day in range(days)]
    rows = each(a_day, tasks, workers)
    shown = []
    for name in case:
        own = [row for row in rows if row["case"] == name]
        lens = [inside for row in own for inside in row["lens"]]
        shown.append(
            {
                "case": name,
                "what errs": ", ".join(sorted(_CASES[name][3])) or "nothing",
                "right": f"{sum(row['right'] for row in own)} of {len(own)}",
                "aside": sum(row["aside"] for row in own),
                "lens within 2 std": f"{np.mean(lens):.2f} of {len(lens)}" if lens else "",
                "left [px]": f"{np.median([row['after_px'] for row in own]):.3f}",
            }
        )
    return [table(shown)], rows


def a_day(name: str, seed: int) -> Row:
    """One day, measured and diagnosed."""
    truth = _CASES[name][3]
    with tempfile.TemporaryDirectory() as folder:
        path, table_path, lens = written(Path(folder), name, seed)
        cell = calib.load_cell(path)
        found = calib.diagnose(cell, calib.load_measurements(cell, table_path))
    sides = {_side(cause.where) for cause in found.causes}
    likely = [cause for cause in found.causes if cause.probability > _UNLIKELY]
    return {
        "case": name,
        "seed": seed,
        "causes": [f"{cause.name}:{cause.where}" for cause in found.causes],
        "right": sides == truth,
        "aside": sum(_side(cause.where) not in truth for cause in likely),
        "lens": _inside(found, lens),
        "after_px": float(found.gap.fit_after),
    }


def written(folder: Path, name: str, seed: int) -> tuple[Path, Path, Array]:
    """Cell and table of a day in a folder; the lens, (6,): shares of fx and fy, cx and cy, k1, k2."""
    (shares, centre, k1, k2), arm, size, _ = _CASES[name]
    rng = np.random.default_rng([seed, ord(name)])
    chain = Chain(data_folder("panda_sockets_2") / "robot.urdf")
    path, table_path = folder / "cell.toml", folder / "measurements.csv"
    known = {"mass": _PAYLOAD, "focal": _FOCAL, "center": list(_CENTER), "noise": _NOISE}
    path.write_text(_CELL.format(urdf=chain.path, **known))
    cell = calib.load_cell(path)
    q = _poses(cell, rng)
    lens = np.array([*shares, *centre, k1, k2])
    uv = pixels(chain, q, lens, arm, size) + rng.normal(0.0, _NOISE, (len(q), 88, 2))
    table_path.write_text(_table(cell.robot.joints, q, uv))
    return path, table_path, lens


def _poses(cell: calib.Cell, rng: np.random.Generator) -> Array:
    low, high = cell.robot.sample_limits().T
    q = rng.uniform(low, high, (_DRAWN, cell.robot.dof))
    even, free = rng.uniform(size=(_DRAWN, NUMBERS)), np.ones(cell.robot.dof, dtype=bool)
    q = looking(cell, q, np.zeros(_DRAWN, dtype=int), even, free)
    return q[visible(scene_of(cell, q)).all(axis=1)][:_POSES]


def _side(where: str) -> str:
    return where.partition(":")[0] if where.startswith(("camera:", "board:")) else "arm"


def _inside(found: Any, lens: Array) -> list[bool]:
    """Of every value of the lens that was named: within two standard deviations of the truth."""
    true = dict(zip(("fx", "fy", "cx", "cy", "k1", "k2"), lens, strict=True))
    true |= {"fx": true["fx"] * _FOCAL, "fy": true["fy"] * _FOCAL, "p1": 0.0, "p2": 0.0, "k3": 0.0}
    own = [c for c in found.causes if c.name in ("focal", "principal_point", "distortion")]
    return [
        bool(abs(value - true[parameter.name]) <= 2.0 * std)
        for cause in own
        for parameter, value, std in zip(
            cause.named.candidate.effect.parameters, cause.values, cause.std, strict=True
        )
    ]


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
            T = np.eye(4)
            T[:3, :3] = _about(2, rpy[2]) @ _about(1, rpy[1]) @ _about(0, rpy[0])
            T[:3, 3] = xyz
            self.links.append((T, joint.get("type") == "revolute"))

    def frames(self, q: Array) -> list[Array]:
        """Frames of the joints, which turn about z, and of the tip last, for one pose (dof,)."""
        T, found, angles = np.eye(4), [], iter(q)
        for link, turns in self.links:
            T = T @ link
            if turns:
                found.append(T)
                turned = np.eye(4)
                turned[:3, :3] = _about(2, next(angles))
                T = T @ turned
        return [*found, T]


def _about(axis: int, angle: float) -> Array:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R, c, s = np.eye(3), np.cos(angle), np.sin(angle)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def pixels(chain: Chain, q: Array, lens: Array, arm: float, size: float) -> Array:
    """What a true camera sees, (m, 88, 2); arm : zero for a perfect arm; size : of the board."""
    import cv2

    fx, fy, cx, cy, k1, k2 = lens
    K = np.array(
        [
            [_FOCAL * (1.0 + fx), 0, _CENTER[0] + cx],
            [0, _FOCAL * (1.0 + fy), _CENTER[1] + cy],
            [0, 0, 1],
        ]
    )
    grid = np.array([[x, y, 0.0] for y in range(1, 9) for x in range(1, 12)]) * 0.02 * size
    board, camera = np.diag([1.0, -1.0, -1.0, 1.0]), np.eye(4)
    board[:3, 3] = 0.5, -0.11, 0.0
    camera[:3, :3], camera[:3, 3] = _about(2, np.pi / 2.0), (0.05, 0.0, 0.05)
    found = []
    for own in q:
        true = own + arm * np.array([0.0, 8e-4, 0.0, -6e-4, 0.0, 0.0, 0.0])
        *joints, tip = chain.frames(true)
        lever = np.cross(tip[:3, 3] - joints[3][:3, 3], [0.0, 0.0, -_PAYLOAD * _GRAVITY])
        true[3] += arm * _COMPLIANCE * float(joints[3][:3, 2] @ lever)
        seen = np.linalg.inv(chain.frames(true)[-1] @ camera) @ board
        uv, _ = cv2.projectPoints(
            grid, cv2.Rodrigues(seen[:3, :3])[0], seen[:3, 3], K, np.array([k1, k2, 0.0, 0.0, 0.0])
        )
        found.append(uv[:, 0])
    return np.array(found)


def _table(joints: Sequence[str], q: Array, uv: Array) -> str:
    lines = [
        ",".join(["pose", "instrument", "marker", *(f"{j}_rad" for j in joints), "u_px", "v_px"])
    ]
    for k, (own, points) in enumerate(zip(q, uv, strict=True)):
        shared = ",".join(f"{value:.9f}" for value in own)
        lines += [
            f"p{k + 1:02d},camera,board:{i},{shared},{u:.5f},{v:.5f}"
            for i, (u, v) in enumerate(points)
        ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
