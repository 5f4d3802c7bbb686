"""Arms of every kind, and how they are driven: sensibly, or so that little can be told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.research.fuzz_days.readers import READERS, Row, Scene
from studies.research.withheld.robots import HEAVY, LIGHT, RAIL, Arm, Array, Joint
from studies.research.withheld.tables import csv_text
from studies.research.withheld.truth import tip_in_numpy, urdf

KINDS = ("light", "heavy", "rail", "seven", "scara", "gantry", "random")
MOTIONS = (
    "free", "free", "narrow", "still", "level", "one", "two", "line",
)  # fmt: skip
_LENGTH = 0.35  # m, of a link


def draw_arm(rng: np.random.Generator) -> Arm:
    """An arm of one of the kinds."""
    kind = str(rng.choice(KINDS))
    known = {"light": LIGHT, "heavy": HEAVY, "rail": RAIL}
    if kind in known:
        return known[kind]
    slides: tuple[bool, ...]
    if kind == "scara":
        slides, axes = (False, False, True, False), np.tile([0.0, 0.0, 1.0], (4, 1))
    elif kind == "gantry":
        slides, axes = (True, True, True, False, False), np.eye(3)[[0, 1, 2, 2, 0]]
    else:
        count = 7 if kind == "seven" else int(rng.integers(1, 8))
        slides = tuple((rng.random(count) < (0.0 if kind == "seven" else 0.2)).tolist())
        axes = np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1.0, 1.0], (count, 1))
    straight = kind in ("scara", "gantry")
    joints = tuple(
        _joint(rng, f"j{k + 1}", axis, slide, straight)
        for k, (axis, slide) in enumerate(zip(axes, slides, strict=True))
    )
    return replace(LIGHT, name=kind, joints=joints, base="base", tip="tip", tool=0.1)


def _joint(rng: np.random.Generator, name: str, axis: Array, slides: bool, straight: bool) -> Joint:
    x, y, z = rng.uniform(-_LENGTH, _LENGTH, 3).round(3).tolist()
    rpy = (0.0, 0.0, 0.0) if straight else tuple(rng.choice([0.0, np.pi / 2.0, 0.3], 3).tolist())
    high = 0.6 if slides else 2.5
    ax, ay, az = axis.tolist()
    mass = float(rng.uniform(0.5, 20.0))
    return Joint(
        name, (x, y, z), (ax, ay, az), -high, high, mass, (0.1, 0.0, 0.0), 1e-5, rpy, slides
    )


def reach(arm: Arm) -> float:
    """Length of the stretched arm, m."""
    steps = [np.linalg.norm(j.xyz) + (j.slides and max(-j.low, j.high)) for j in arm.joints]
    return float(np.sum(steps) + np.linalg.norm(arm.tip_xyz))


def draw_joints(rng: np.random.Generator, arm: Arm, motion: str, count: int) -> Array:
    """Joints at each pose, shape (count, n), rad or m."""
    low, high = arm.limits.T
    free = low + rng.random((count, arm.dof)) * (high - low)
    middle = low + rng.uniform(0.2, 0.8, arm.dof) * (high - low)
    if motion == "narrow":
        return np.asarray(middle + (free - middle) * 10.0 ** rng.uniform(-4.0, -1.0))
    if motion == "one":
        own = int(rng.integers(arm.dof))
        return np.asarray(np.where(np.arange(arm.dof) == own, free, middle))
    if motion == "two":
        return np.asarray(free[rng.integers(0, min(2, count), count)])
    if motion == "line":
        return np.asarray(
            middle + np.linspace(-0.3, 0.3, count)[:, None] * rng.normal(size=arm.dof)
        )
    if motion == "still":
        return np.asarray(np.tile(middle, (count, 1)))
    if motion == "level":
        return _level(arm, free, middle)
    return np.asarray(free)


def _level(arm: Arm, free: Array, middle: Array) -> Array:
    """The flange does not turn: what slides moves, and of parallel neighbours two against the third."""
    q = np.where(arm.slides, free, middle)
    for k in range(arm.dof - 2):
        three = arm.joints[k : k + 3]
        flat = not any(j.slides for j in three) and not any(any(j.rpy) for j in three[1:])
        if flat and np.ptp(arm.axes[k : k + 3], axis=0).max() == 0.0:
            q[:, k : k + 2] = middle[k : k + 2] + 0.3 * (free - middle)[:, k : k + 2]
            q[:, k + 2] = middle[k + 2] - (q[:, k : k + 2] - middle[k : k + 2]).sum(axis=1)
            break
    return np.asarray(q)


def approached(q: Array) -> NDArray[np.int_]:
    """Sign of the last motion of each joint, shape (m, n)."""
    return np.sign(np.diff(q, axis=0, prepend=q[:1])).astype(int)


_KINDS = ("points", "points", "points", "pose", "pose", *READERS)
_FEW = ("thermal_expansion", "backlash", "gravity_sag", "transmission_harmonic", "base_compliance",
        "joint_coupling", "settling", "link_weight", "tracker_drift", "bearing_compliance",
        "stiffness_vs_angle", "tracker_scale", "friction_windup", "warm_up")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Day:
    """What a day is called, and the room that its places are in, m."""

    name: str
    room: float
    joints: tuple[str, ...]


def draw_day(rng: np.random.Generator, folder: Path) -> Day:
    """Write cell.toml, robot.urdf, measurements.csv and targets.csv into a folder."""
    arm = draw_arm(rng)
    kind, motion = str(rng.choice(_KINDS)), str(rng.choice(MOTIONS))
    count = int(rng.integers(3, 61)) if rng.random() < 0.3 else int(rng.integers(12, 61))
    q = draw_joints(rng, arm, motion, count)
    if rng.random() < 0.2:
        q[-1] = q[0]
    error = np.zeros((arm.dof + 2, 6)) if rng.random() < 0.1 else _errors(rng, arm)
    slack = rng.choice([0.0, 0.0, 1e-3]) * rng.random(arm.dof)
    R, p = tip_in_numpy(arm, q + approached(q) * slack, error)
    stations = int(rng.choice([1, 1, 1, 2, 3])) if kind in ("points", "pose") else 1
    station = np.sort(rng.integers(0, stations, count))
    sigma = float(10.0 ** rng.uniform(-6.5, -3.0))
    on_tip, guess = _on_tip(rng, arm)
    loud = float(rng.choice([0.0, 1.0, 1.0, 1.0, 10.0]))
    scene = Scene(R, p, station, on_tip, guess, sigma, loud)
    text, rows = READERS[kind](rng, scene)
    rows = _spoilt(rng, rows)
    known = _covariates(rng, count)
    if len(np.unique(station)) > 1:
        known["station"] = [f"s{k}" for k in station]
    files = {
        "robot.urdf": urdf(arm, bool(rng.random() < 0.6)),
        "cell.toml": _cell(rng, arm, text),
        "measurements.csv": _table(arm, q, rows, known),
        "targets.csv": _table(
            arm, draw_joints(rng, arm, "free", 4), [(i, {}) for i in range(4)], {}
        ),
        "plan.csv": _table(arm, q, [(i, {}) for i in range(count)], {}),
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8")
    return Day(f"{arm.name} {kind} {motion} {count}", _room(arm, rows), arm.names)


def _room(arm: Arm, rows: list[Row]) -> float:
    lengths = [abs(float(v)) for _, row in rows for k, v in row.items() if k.endswith("_mm")]
    return 10.0 * reach(arm) + 2e-3 * max(lengths, default=0.0)


def _errors(rng: np.random.Generator, arm: Arm) -> Array:
    return np.asarray(rng.normal(size=(arm.dof + 2, 6)) * 10.0 ** rng.uniform(-6.0, -1.5))


def _on_tip(rng: np.random.Generator, arm: Arm) -> tuple[Array, Array]:
    """Markers on the tip, (M, 3), m, and what the cell says of them: nothing, roughly, or exactly."""
    count = int(rng.choice([1, 1, 2, 3, 3, 4]))
    places = rng.normal(scale=arm.tool, size=(count, 3))
    if rng.random() < 0.2:
        places = np.outer(rng.normal(size=count), rng.choice([0.0, 1.0], 3)) * arm.tool  # in line
    off = rng.choice([0.0, 1e-3, 0.3, np.inf])
    guess = (
        np.zeros_like(places)
        if off == np.inf
        else places + rng.normal(scale=off, size=places.shape)
    )
    return places, guess


def _spoilt(rng: np.random.Generator, rows: list[Row]) -> list[Row]:
    """Rows with some of them hidden, some wrong, and some there twice."""
    first = {row[1]["marker"]: row for row in reversed(rows)}.values()  # each is seen once
    if rng.random() < 0.3:
        rows = [row for row in rows if rng.random() < 0.7 or any(row is f for f in first)]
    if rng.random() < 0.2:
        size = float(10.0 ** rng.uniform(-1.0, 4.0))
        for _, row in (rows[k] for k in rng.integers(0, max(len(rows), 1), 2) if rows):
            name = next((c for c in ("x_mm", "d_mm", "u_px") if c in row), None)
            if name:
                row[name] = f"{float(row[name]) + size:.9g}"
    if rng.random() < 0.02 and rows:
        rows = [*rows, rows[-1]]
    return rows


def _covariates(rng: np.random.Generator, count: int) -> dict[str, list[str]]:
    known: dict[str, list[str]] = {}
    if rng.random() < 0.5:
        known["time_s"] = [f"{60 * i}" for i in range(count)]
    if rng.random() < 0.4:
        known["temperature_degC"] = [f"{20 + 5 * x:.3f}" for x in rng.random(count)]
    if rng.random() < 0.4:
        known |= {c: [f"{x:.2f}" for x in rng.normal(scale=s, size=count)]
                  for c, s in zip(("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"),
                                  (50, 50, 300, 5, 5, 5), strict=True)}  # fmt: skip
    return known


def _cell(rng: np.random.Generator, arm: Arm, text: str) -> str:
    effects = [
        e
        for e, share in (("base", 0.93), ("tool", 0.85), ("geometry", 0.5))
        if rng.random() < share
    ]
    if "geometry" not in effects and rng.random() < 0.5:
        effects.append("joint_offset")
    if rng.random() < 0.3:
        effects.append(str(rng.choice(["joint_compliance", f"joint_compliance:{arm.names[-1]}"])))
    if rng.random() < 0.25:
        effects.append(str(rng.choice(_FEW)))
    payload = "[payload]\nmass_kg = 3.0\ncom_mm = [10, 0, 50]\n" if rng.random() < 0.3 else ""
    repeats = "repeatability_mm = 0.02\nrepeatability_urad = 20\n" if rng.random() < 0.3 else ""
    listed = ", ".join(f'"{e}"' for e in effects)
    return (
        f'schema = 1\nname = "day"\n[robot]\nurdf = "robot.urdf"\nbase = "{arm.base}"\n'
        f'tip = "{arm.tip}"\n{repeats}{text}{payload}[model]\neffects = [{listed}]\n'
    )


def _table(arm: Arm, q: Array, rows: list[Row], known: dict[str, list[str]]) -> str:
    own = list(dict.fromkeys(name for _, row in rows for name in row))
    joints = [f"{j.name}_{'mm' if j.slides else 'deg'}" for j in arm.joints]
    shown = np.where(arm.slides, 1e3, 180.0 / np.pi) * q
    table = [["pose", *joints, *known, *own]]
    for i, row in rows:
        given = [f"{x:.10g}" for x in shown[i]]
        table.append(
            [f"p{i}", *given, *(v[i] for v in known.values()), *(row.get(c, "") for c in own)]
        )
    return csv_text(table)
