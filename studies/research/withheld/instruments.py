"""Cases that cameras, wires, motion capture and sockets read, with faults of these; files and keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from studies.research.withheld.causes import Cause, draw_cause
from studies.research.withheld.draw import EASY, NoSuchCase, draw_scene
from studies.research.withheld.figures import DRAWN, READERS
from studies.research.withheld.judge import SI, unit
from studies.research.withheld.keys import write_texts
from studies.research.withheld.readers import (
    Bodies,
    Camera,
    Nests,
    Reader,
    Touching,
    View,
    Wire,
    turned,
)
from studies.research.withheld.robots import ARMS, Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.tables import csv_text
from studies.research.withheld.truth import Mechanism
from studies.research.withheld.visible import at_rest

SHARES = {"null": 0.25, "single": 0.40, "instrument": 0.35}
_ARM = ("joint_offset", "transmission_harmonic", "backlash", "joint_coupling", "joint_compliance")
_FAULTS = {
    "world camera": ("focal_scale", "focal_drift", "focal_expansion", "board_scale", "moved"),
    "tip camera": ("focal_scale", "focal_drift", "focal_expansion", "board_scale", "moved"),
    "socket": ("step", "socket_seat"),
}
_NONCENTRALITY = (60.0, 3000.0)
_CONDITIONS = replace(EASY, configurations=45, known_geometry=True)
_NARROW = 0.12  # of the joints' ranges: a board in the world stays before a camera on the tip
_FEWEST = 50  # readings of a fit
_LARGEST = {"focal_scale": 0.03, "board_scale": 0.03, "focal_drift": 3e-3, "focal_expansion": 8e-4}
_ROUNDS, _CLOSER = 10, 6
_NEAR = 1e-4  # m: from there contact is reached
Sites = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Fault:
    """What is wrong with an instrument, of size one: the parameter, or metres and radians.

    where : names in the answers, any of which is right
    """

    effect: str
    where: tuple[str, ...]
    motion: Array
    size: float = 1.0


@dataclass(frozen=True, eq=False)
class Sensed:
    """A case. rows : ndarray, shape (N, C, r), what stands in the table, NaN where nothing does."""

    family: str
    kind: str
    scene: Scene
    reader: Reader
    cause: Cause | Fault | None
    noncentrality: float
    rows: Array
    site: Sites


def draw_sensed(rng: np.random.Generator, family: str, kind: str = "") -> Sensed:
    """A case of one family, read by a kind of reader if it is named."""
    kinds = (kind,) if kind else tuple(_FAULTS) if family == "instrument" else READERS
    while True:
        try:
            return _filled(rng, family, str(rng.choice(kinds)))
        except NoSuchCase:
            continue


def _filled(rng: np.random.Generator, family: str, kind: str) -> Sensed:
    scene = draw_scene(rng, ARMS[int(rng.integers(2))], _CONDITIONS)
    scene = replace(scene, compliance=scene.compliance * 0.0, modelled=(), knots={})
    if kind == "tip camera":
        session = scene.session
        q = session.q[0] + _NARROW * (session.q - session.q[0])
        q = np.radians(np.round(np.degrees(q), 6))
        scene = replace(scene, session=replace(session, q=q))
    mechanism = scene.mechanism()
    reader = _placed(rng, kind, scene, mechanism)
    site = np.arange(scene.count) % 4
    cause, there = _drawn(rng, family, kind, scene, reader), np.ones(scene.count, dtype=bool)
    if isinstance(reader, Nests):
        scene = _reached(scene, mechanism, reader, site)
        _, off = _toward_contact(mechanism, reader, site, scene.session.q)
        there = np.linalg.norm(off, axis=1) < _NEAR
    day, found = Day(scene, mechanism, reader, site, there), 0.0
    if cause is not None:
        cause, found = _sized(rng, day, cause)
    if isinstance(reader, Nests):
        scene, there = _in_contact(rng, day, reader, cause)
        rows = np.where(there, 0.0, np.nan)[:, None, None]
    else:
        rows = reader.noisy(rng, day.rows(cause))
    read = np.isfinite(rows).all(axis=-1).sum(axis=1) > 0
    if np.count_nonzero(read & ~scene.session.held) < _FEWEST:
        raise NoSuchCase
    return Sensed(family, kind, scene, reader, cause, found, rows, site)


@dataclass(frozen=True, eq=False)
class Day:
    """What the reader reads of the scene, with a cause or without.

    there : ndarray of bool, shape (N,), where it can
    """

    scene: Scene
    mechanism: Mechanism
    reader: Reader
    site: Sites
    there: NDArray[np.bool_]

    def view(self, cause: Cause | Fault | None) -> View:
        """The tip, and what is wrong with the reader."""
        scene, own = self.scene, cause if isinstance(cause, Fault) else None
        state = at_rest(scene, self.mechanism, [cause] if isinstance(cause, Cause) else [])
        count, session = scene.count, scene.session
        larger, apart, seat = np.zeros(count), np.zeros((count, 6)), np.zeros((count, 3))
        pitch = 0.0
        if own is not None:
            after = (np.arange(count) >= 0.5 * count)[:, None]
            there = (self.site == 1)[:, None] | (
                len(own.where) > 0 and "socket" not in own.where[0]
            )
            larger = own.size * {
                "focal_scale": np.ones(count),
                "focal_drift": session.hours,
                "focal_expansion": session.temperature - 20.0,
            }.get(own.effect, np.zeros(count))
            pitch = own.size if own.effect == "board_scale" else 0.0
            apart = (
                apart + (own.effect in ("step", "moved")) * after * there * own.size * own.motion
            )
            seat = seat + (own.effect == "socket_seat") * there * own.size * own.motion[:3]
        return View(state.R_link[:, -1], state.o[:, -1], self.site, larger, pitch, apart, seat)

    def rows(self, cause: Cause | Fault | None) -> Array:
        """Readings without noise."""
        return self.reader.rows(self.view(cause), *self._still)

    @property
    def _still(self) -> tuple[Array, Array]:
        return np.zeros(self.reader.places), np.zeros(self.reader.tips)

    def noncentrality(self, cause: Cause | Fault) -> float:
        """Of what the cause does, beside an unknown place and an unknown tip, at the fitted poses."""
        view, reader, (place, tip) = self.view(None), self.reader, self._still
        fitted = self.there & ~self.scene.session.held
        both = np.concatenate([place, tip])

        def read(x: Array) -> Array:
            return reader.rows(view, x[: len(place)], x[len(place) :])

        steps = 1e-6 * np.eye(len(both))
        columns = [reader.off(read(h), read(-h))[fitted].ravel() / 2e-6 for h in steps]
        moved = reader.off(self.rows(cause), read(both))[fitted].ravel()
        J = np.column_stack(columns)
        seen = np.isfinite(moved) & np.isfinite(J).all(axis=1)
        if seen.sum() < 2 * len(both):
            raise NoSuchCase
        left = moved[seen] - J[seen] @ np.linalg.lstsq(J[seen], moved[seen], rcond=None)[0]
        return float(left @ left)


def _placed(rng: np.random.Generator, kind: str, scene: Scene, mechanism: Mechanism) -> Reader:
    """Where the reader stands and what it reads, so that it can."""
    state = at_rest(scene, mechanism, ())
    R, p, tool = state.R_link[:, -1], state.o[:, -1], scene.arm.tool
    on = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3) * tool
    reach = float(np.linalg.norm(p - p.mean(axis=0), axis=1).max())
    away = rng.normal(size=3)
    away = away / np.linalg.norm(away)
    if kind == "world camera":
        eye = p.mean(axis=0) + 3.0 * reach * away
        shape = rng.uniform(-1.0, 1.0, (9, 3)) * tool
        return Camera(_toward(rng, -away), eye, *on, shape, rides=False)
    if kind == "tip camera":
        ahead = R[0] @ on[0], p[0] + R[0] @ (on[1] + on[0] @ [0.0, 0.0, 8.0 * tool])
        flat = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) - [2.0, 1.5, 0.0]
        tilt = turned(np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3.0, 3.0)]))
        return Camera(*on, ahead[0] @ tilt, ahead[1], flat * 0.6 * tool, rides=True)
    frame = Rotation.random(rng=rng).as_matrix(), p.mean(axis=0) + 2.5 * reach * away
    if kind == "pose":
        return Bodies(*frame, *on)
    ball = rng.uniform(0.4, 1.0, 3) * tool
    guess, sigma = ball + rng.normal(size=3) * 3e-3, 3.0 * scene.arm.sigma
    if kind == "distance":
        return Wire(*frame, on[0], ball, guess, sigma)
    centres = (p + R @ ball)[rng.permutation(scene.count)[:4]]
    return Nests(*frame, on[0], ball, guess, sigma, centres)


def _toward(rng: np.random.Generator, z: Array) -> Array:
    """Axes of a camera that looks along z."""
    x = np.cross(z, rng.normal(size=3))
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _drawn(
    rng: np.random.Generator, family: str, kind: str, scene: Scene, reader: Reader
) -> Cause | Fault | None:
    if family == "null":
        return None
    if family == "single":
        while (cause := draw_cause(rng, scene)).effect not in _ARM:
            pass
        return cause
    effect = str(rng.choice(_FAULTS[kind]))
    motion = np.concatenate([rng.normal(size=3) * 3e-4, rng.normal(size=3) * 3e-4])
    where: tuple[str, ...] = ("camera:eye",)
    if isinstance(reader, Nests):
        where = ("socket:nest_1",)
    elif effect == "board_scale":
        where = ("board:plate",)
    elif effect == "moved" and not (isinstance(reader, Camera) and reader.rides):
        where = ("camera:eye", "base")  # one and the same, from what it reads
    return Fault(effect, where, motion)


def _sized(rng: np.random.Generator, day: Day, cause: Cause | Fault) -> tuple[Cause | Fault, float]:
    """The cause at a noncentrality drawn evenly in its logarithm. Raises NoSuchCase."""
    wanted = float(np.exp(rng.uniform(*np.log(_NONCENTRALITY))))
    scaled: Callable[[Cause | Fault, float], Cause | Fault]
    scaled = lambda c, f: replace(c, size=c.size * f)  # noqa: E731
    if isinstance(cause, Fault) and cause.effect in _LARGEST:
        cause = replace(cause, size=0.1 * _LARGEST[cause.effect] * float(rng.choice([-1.0, 1.0])))
    for _ in range(4):
        try:
            reached = day.noncentrality(cause)
        except RuntimeError:
            raise NoSuchCase from None
        factor = float(np.sqrt(wanted / max(reached, 1e-9)))
        if abs(factor - 1.0) < 0.02:
            return cause, reached
        cause = scaled(cause, factor)
        if _absurd(cause):
            raise NoSuchCase
    raise NoSuchCase


def _absurd(cause: Cause | Fault) -> bool:
    if isinstance(cause, Fault):
        most = _LARGEST.get(cause.effect, np.inf)
        return abs(cause.size) > most or (most == np.inf and cause.size > 10.0)
    return max(abs(v * cause.size) for v in cause.values.values()) > 3e-3


def _reached(scene: Scene, mechanism: Mechanism, reader: Touching, site: Sites) -> Scene:
    """The scene with joints at which a rigid arm without causes has the ball in its sockets."""
    q = scene.session.q.copy()
    for _ in range(_ROUNDS):
        follow, off = _toward_contact(mechanism, reader, site, q)
        q = q + _short(-(follow @ off[..., None])[..., 0])
    return replace(scene, session=replace(scene.session, q=q))


def _toward_contact(
    mechanism: Mechanism, reader: Touching, site: Sites, q: Array
) -> tuple[Array, Array]:
    """How joints follow the ball, (N, n, 3), and how far it is off, (N, 3), m."""
    none = np.zeros((len(q), 6))

    def off(q: Array) -> Array:
        state = mechanism.posed(q)
        tip = state.R_link[:, -1], state.o[:, -1]
        view = View(*tip, site, none[:, 0], 0.0, none, none[:, :3])
        return reader.rows(view, np.zeros(reader.places), np.zeros(reader.tips))[:, 0]

    ends = [off(q + h) - off(q - h) for h in 1e-5 * np.eye(q.shape[1])]
    return np.asarray(np.linalg.pinv(np.stack(ends, axis=-1) / 2e-5, rcond=1e-2), float), off(q)


def _short(step: Array) -> Array:
    largest = np.maximum(np.abs(step).max(axis=1), 1e-12)
    return np.asarray(step * np.minimum(1.0, 0.3 / largest)[:, None])


def _in_contact(
    rng: np.random.Generator, day: Day, reader: Touching, cause: Cause | Fault | None
) -> tuple[Scene, NDArray[np.bool_]]:
    """The scene with joints at which the ball is in its socket, but for noise, and where that is so."""
    scene, q = day.scene, day.scene.session.q.copy()
    noise = rng.normal(scale=reader.sigma, size=(scene.count, 3))
    follow, _ = _toward_contact(day.mechanism, reader, day.site, q)
    for _ in range(_CLOSER):
        here = replace(scene, session=replace(scene.session, q=q))
        off = replace(day, scene=here).rows(cause)[:, 0] - noise
        there = np.linalg.norm(off, axis=1) < 1e-7
        q = q + np.where(there[:, None], 0.0, _short(-(follow @ off[..., None])[..., 0]))
    low, high = scene.arm.limits.T
    return here, there & ((q > low) & (q < high)).all(axis=1)


_UNITS = {
    "focal_scale": ("scale", "ppm"),
    "board_scale": ("scale", "ppm"),
    "focal_drift": ("rate", "ppm/h"),
    "focal_expansion": ("growth", "ppm/K"),
}


def write_case(folder: Path, case: Sensed) -> None:
    """Write cell.toml, robot.urdf, measurements.csv and heldout.csv into a new folder."""
    write_texts(folder, case.scene, cell_text(folder.name, case), partial(table_text, case))


def cell_text(name: str, case: Sensed) -> str:
    """The measurement cell with the user's model: nothing but places."""
    arm = case.scene.arm
    return (
        f'schema = 1\nname = "{name}"\n[robot]\nurdf = "robot.urdf"\nbase = "{arm.base}"\n'
        f'tip = "{arm.tip}"\n{case.reader.cell}[model]\neffects = ["base", "tool"]\n'
    )


def table_text(case: Sensed, poses: NDArray[np.int_]) -> str:
    """Rows of some poses, in order of time."""
    session, arm = case.scene.session, case.scene.arm
    header = ["pose", "instrument", "marker", *(f"{name}_deg" for name in arm.names)]
    header += ["temperature_degC", "time_s", *(f"approach_{name}" for name in arm.names)]
    header += ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm", *case.reader.columns]
    rows = [header]
    for i in poses:
        known = [f"{x:.10f}" for x in np.degrees(session.q[i])]
        known += [f"{session.temperature[i]:.3f}", f"{session.time[i]:.1f}"]
        known += [f"{x:.0f}" for x in session.approach[i] + 0.0]
        known += [f"{x:.4f}" for x in case.scene.wrench[i]]
        for c in np.flatnonzero(np.isfinite(case.rows[i]).all(axis=-1)).tolist():
            instrument, marker, numbers = case.reader.told(case.rows[i, c], c, int(case.site[i]))
            rows.append([session.names[i], instrument, marker, *known, *numbers])
    return csv_text(rows)


def key_of(case: Sensed, name: str, index: int, salt: str) -> dict[str, Any]:
    """Everything that scoring needs."""
    return {
        "schema": 1,
        "salt": salt,
        "case": name,
        "index": index,
        "draw": DRAWN,
        "family": case.family,
        "robot": case.scene.arm.name,
        "conditions": {
            **asdict(EASY),
            "known_geometry": True,
            "rigid": [],
            "reader": case.kind,
        },
        "effects": [] if case.cause is None else [_entry(case, case.cause)],
        "outside": None,
        "noncentrality": case.noncentrality,
        "floor_mm": case.reader.floor,  # px of a camera, as the answers have it
        "outliers": [],
    }


def _entry(case: Sensed, cause: Cause | Fault) -> dict[str, Any]:
    where = cause.where if isinstance(cause, Fault) else (cause.where,)
    return {
        "effect": cause.effect,
        "where": where[0],
        "places": list(where),
        "twins": [f"{cause.effect}:{other}" for other in where[1:]],
        "noncentrality": case.noncentrality,
        "beside": case.noncentrality,
        "parameters": list(_parameters(cause)),
    }


def _parameters(cause: Cause | Fault) -> list[dict[str, Any]]:
    """Those whose value does not hang on where the clock or a frame begins."""
    if isinstance(cause, Fault):
        own = _UNITS.get(cause.effect)
        told = [] if own is None else [(*own, cause.size / SI[own[1]])]
    else:
        named = [(n, unit(cause.effect, n), v * cause.size) for n, v in cause.values.items()]
        told = [(n, shown, v / SI[shown]) for n, shown, v in named]
    return [{"name": n, "value": v, "unit": u, "scored": True} for n, u, v in told]
