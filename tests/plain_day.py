"""Days of a tracker before an arm that errs, bends and grows, in plain numpy.

Nothing here knows how posecal predicts, derives or weighs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib.arrays import Array
from tests.plain_arm import frame, rotation

SIGMA = 1e-5
MASS, COM = 25.0, np.array([0.1, 0.0, 0.15])
ROWS = ((90, 0, 450), (0, 600, 0), (90, 120, 0), (-90, 0, 600), (0, 80, 90))
"""Of the DH table: alpha, deg, a and d, mm."""
LIMITS = np.array([[-150, 150], [-20, 120], [-110, 60], [-170, 170], [-110, 110]])  # deg
MARKERS = np.array([[0.10, 0.02, 0.05], [-0.06, 0.09, 0.12], [0.03, -0.11, 0.09]])
BASE = np.array([2.4, 0.9, -0.6, 0.2, -0.1, 2.1])
PAYLOAD = f"[payload]\nmass_kg = {MASS}\ncom_mm = {(1e3 * COM).tolist()}\n"
EFFECTS = '"base", "tool", "joint_offset:J2,J3,J4", "joint_compliance:J2,J3"'
WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")


def _none() -> Array:
    return np.zeros(5)


@dataclass(frozen=True, eq=False)
class Errors:
    """Of each joint, (5,): offset and half of its lost motion (gap), rad; soft, rad/(N m); growth, 1/K.

    place : of the base, m and rad; markers : (M, 3), m
    """

    offset: Array = field(default_factory=_none)
    soft: Array = field(default_factory=_none)
    gap: Array = field(default_factory=_none)
    growth: Array = field(default_factory=_none)
    place: Array = field(default_factory=BASE.copy)
    markers: Array = field(default_factory=MARKERS.copy)


def errors_of(values: Array) -> Errors:
    """Base, markers, three offsets and two compliances, (20,), as the cell's model has them."""
    return Errors(
        offset=np.array([0.0, *values[15:18], 0.0]),
        soft=np.array([0.0, *values[18:], 0.0, 0.0]),
        place=values[:6],
        markers=values[6:15].reshape(3, 3),
    )


VALUES = np.concatenate([BASE, MARKERS.ravel() + 1e-3, [8e-4, -6e-4, 5e-4], [2.5e-6, 3e-6]])
TRUE = errors_of(VALUES)


def write_cell(
    folder: Path, effects: str = EFFECTS, robot: str = "repeatability_mm = 0", more: str = PAYLOAD
) -> Path:
    """robot : lines of [robot]; more : tables"""
    rows = [f"J{k},{alpha},{a},0,{d}" for k, (alpha, a, d) in enumerate(ROWS, 1)]
    (folder / "arm.csv").write_text("\n".join(["joint,alpha_deg,a_mm,theta_deg,d_mm", *rows, ""]))
    limits = "".join(f"J{k} = {own.tolist()}\n" for k, own in enumerate(LIMITS, 1))
    markers = "".join(f"m{k} = {(1e3 * own).tolist()}\n" for k, own in enumerate(MARKERS, 1))
    (folder / "cell.toml").write_text(
        f'schema = 1\n[robot]\ndh = "arm.csv"\ndh_convention = "classic"\n{robot}\n'
        f"[robot.limits_deg]\n{limits}[markers_mm]\n{markers}{more}"
        f"[instrument]\nsigma_mm = 0.01\n[model]\neffects = [{effects}]\n"
    )
    return folder / "cell.toml"


def joints(count: int, rng: np.random.Generator) -> Array:
    low, high = np.radians(LIMITS).T
    return rng.uniform(low, high, (count, 5))


def frames(q: Array, grown: Array) -> list[Array]:
    """Before every joint and behind the last, (m, 4, 4); grown : (m, 5), share of each link."""
    T = [np.tile(np.eye(4), (len(q), 1, 1))]
    for k, (alpha, a, d) in enumerate(ROWS):
        link = np.array([1e-3 * a, 0.0, 1e-3 * d]) * (1.0 + grown[:, [k]])
        turned = frame(q[:, [k]] * np.eye(6)[5])
        leaned = np.tile([np.radians(alpha), 0.0, 0.0], (len(q), 1))
        T.append(T[-1] @ turned @ frame(np.concatenate([link, leaned], axis=1)))
    return T


def points(
    own: Errors, q: Array, wrench: Array | None = None, approach: Array | float = 0.0,
    warming: Array | None = None, mass: float = MASS,
) -> Array:  # fmt: skip
    """Markers in the tracker's frame, shape (m, M, 3), m; wrench : on the tip, base axes."""
    F, M = np.split(np.zeros((len(q), 6)) if wrench is None else wrench, 2, axis=1)
    grown = (np.zeros(len(q)) if warming is None else warming)[:, None] * own.growth
    weight = np.array([0.0, 0.0, -9.80665 * mass])
    actual = q + own.offset + own.gap * approach
    T = frames(actual, grown)
    for _ in range(4):
        tip = T[-1][:, :3, 3]
        com = T[-1][:, :3, :3] @ COM + tip
        bent = actual.copy()
        for k in np.flatnonzero(own.soft):
            axis, o = T[k][:, :3, 2], T[k][:, :3, 3]
            moment = M + np.cross(tip - o, F) + np.cross(com - o, weight)
            bent[:, k] += own.soft[k] * (axis * moment).sum(axis=1)
        T = frames(bent, grown)
    here = own.markers @ np.swapaxes(T[-1][:, :3, :3], 1, 2) + T[-1][:, None, :3, 3]
    return np.asarray(here @ rotation(own.place[3:]).T + own.place[:3])


def slopes(q: Array) -> Array:
    """Derivatives of all coordinates by the values, shape (9 m, 20), by central differences."""
    steps = np.diag(np.where(np.arange(20) >= 18, 1e-7, 1e-5))
    ends = [points(errors_of(VALUES + s), q) - points(errors_of(VALUES - s), q) for s in steps]
    return np.array([end.ravel() / (2.0 * s.max()) for end, s in zip(ends, steps, strict=True)]).T


def read(true: Array, rng: np.random.Generator) -> Array:
    """What a tracker reads of points (..., 3)."""
    return np.asarray(true + SIGMA * rng.standard_normal(true.shape))


def table(q: Array, read_points: Array, columns: Mapping[str, Array] | None = None) -> str:
    """Measurements as a file; columns : further ones (m,)."""
    more = columns or {}
    header = ["pose", "marker", *(f"J{k}_rad" for k in range(1, 6)), "x_m", "y_m", "z_m", *more]
    rows = [",".join(header)]
    for i, (angles, own) in enumerate(zip(q, read_points, strict=True)):
        for j, point in enumerate(own, 1):
            numbers = [*(f"{a:.12f}" for a in angles), *(f"{c:.9f}" for c in point)]
            known = [f"{c[i]:.9g}" for c in more.values()]
            rows.append(",".join([f"p{i:02d}", f"m{j}", *numbers, *known]))
    return "\n".join([*rows, ""])
