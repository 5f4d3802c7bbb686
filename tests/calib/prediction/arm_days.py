"""Days of a tracker before a bending arm, in plain numpy.

Nothing here knows how posecal predicts, derives or weighs.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from calib.arrays import Array
from tests.plain_arm import rotation, shift, turn

SIGMA = 1e-5
MASS, COM = 25.0, np.array([0.1, 0.0, 0.15])
ROWS = (
    (90.0, 0.0, 450.0),
    (0.0, 600.0, 0.0),
    (90.0, 120.0, 0.0),
    (-90.0, 0.0, 600.0),
    (0.0, 80.0, 90.0),
)
MARKERS = np.array([[0.10, 0.02, 0.05], [-0.06, 0.09, 0.12], [0.03, -0.11, 0.09]])
BASE = np.array([2.4, 0.9, -0.6, 0.2, -0.1, 2.1])
TRUE = np.concatenate([BASE, MARKERS.ravel() + 1e-3, [8e-4, -6e-4, 5e-4], [2.5e-6, 3e-6]])
CELL = """schema = 1
[robot]
dh = "arm.csv"
dh_convention = "classic"
repeatability_mm = 0
[robot.limits_deg]
J1 = [-150, 150]
J2 = [-20, 120]
J3 = [-110, 60]
J4 = [-170, 170]
J5 = [-110, 110]
[markers_mm]
m1 = [100, 20, 50]
m2 = [-60, 90, 120]
m3 = [30, -110, 90]
[payload]
mass_kg = 25.0
com_mm = [100, 0, 150]
[instrument]
sigma_mm = 0.01
[model]
effects = ["base", "tool", "joint_offset:J2,J3,J4", "joint_compliance:J2,J3"]
"""


def write_cell(folder: Path) -> Path:
    rows = [f"J{k + 1},{alpha},{a},0,{d}" for k, (alpha, a, d) in enumerate(ROWS)]
    (folder / "arm.csv").write_text("\n".join(["joint,alpha_deg,a_mm,theta_deg,d_mm", *rows, ""]))
    (folder / "cell.toml").write_text(CELL)
    return folder / "cell.toml"


def joints(count: int, rng: np.random.Generator) -> Array:
    low, high = np.radians([[-150, -20, -110, -170, -110], [150, 120, 60, 170, 110]])
    return rng.uniform(low, high, (count, 5))


def frames(q: Array) -> list[Array]:
    """Of the base and behind every joint."""
    T = [np.eye(4)]
    for angle, (alpha, a, d) in zip(q, ROWS, strict=True):
        T.append(
            T[-1]
            @ turn("z", angle)
            @ shift(a * 1e-3, 0.0, d * 1e-3)
            @ turn("x", math.radians(alpha))
        )
    return T


def points(values: Array, q: Array, force: Array | None = None) -> Array:
    """Markers in the tracker's frame, shape (m, 3, 3), m.

    force : N, on the tip, base axes
    """
    pull = np.zeros(3) if force is None else force
    place, markers, offsets, soft = (
        values[:6],
        values[6:15].reshape(3, 3),
        values[15:18],
        values[18:],
    )
    gravity = np.array([0.0, 0.0, -9.80665])
    R, out = rotation(place[3:]), np.empty((len(q), 3, 3))
    for i, angles in enumerate(q):
        actual = angles + np.array([0.0, *offsets, 0.0])
        bent = actual.copy()
        for _ in range(4):
            T = frames(bent)
            com = T[-1][:3, :3] @ COM + T[-1][:3, 3]
            for joint, compliance in zip((1, 2), soft, strict=True):
                origin = T[joint][:3, 3]
                moment = np.cross(com - origin, MASS * gravity)
                moment = moment + np.cross(T[-1][:3, 3] - origin, pull)
                bent[joint] = actual[joint] + compliance * (T[joint][:3, 2] @ moment)
        T = frames(bent)
        out[i] = (markers @ T[-1][:3, :3].T + T[-1][:3, 3]) @ R.T + place[:3]
    return out


def slopes(values: Array, q: Array) -> Array:
    """Derivatives of all coordinates, shape (9 m, p), by central differences."""
    steps = np.where(np.arange(len(values)) >= 18, 1e-7, 1e-5)
    columns = [
        (points(values + step, q) - points(values - step, q)).ravel() / (2.0 * step.max())
        for step in np.diag(steps)
    ]
    return np.array(columns).T


def read(true: Array, rng: np.random.Generator) -> Array:
    """What a tracker reads of points (..., 3)."""
    return np.asarray(true + SIGMA * rng.standard_normal(true.shape))


def table(
    q: Array,
    read_points: Array,
    names: list[str] | None = None,
    more: dict[str, Array] | None = None,
) -> str:
    """Measurements as a file; more : further columns (m,)."""
    columns = more or {}
    header = ["pose", "marker", *(f"J{k}_rad" for k in range(1, 6)), "x_m", "y_m", "z_m", *columns]
    rows = [",".join(header)]
    for i, own in enumerate(read_points):
        for j, point in enumerate(own):
            row = [
                f"p{i}" if names is None else names[i],
                f"m{j + 1}",
                *(f"{a:.12f}" for a in q[i]),
            ]
            row += [f"{c:.9f}" for c in point] + [f"{c[i]:g}" for c in columns.values()]
            rows.append(",".join(row))
    return "\n".join([*rows, ""])
