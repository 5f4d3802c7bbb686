"""Cases that cameras, wires, motion capture and sockets read, with faults of these."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.truth.arms import ARMS, Array, Mask
from studies.research.truth.causes import Cause, Unsuitable, draw_cause
from studies.research.truth.conditions import Conditions
from studies.research.truth.mechanism import Mechanism
from studies.research.truth.readers import (
    Bodies,
    Camera,
    Nests,
    Reader,
    Sites,
    Touching,
    View,
    Wire,
    rotation,
)
from studies.research.truth.scene import Scene, at_rest, draw_scene

SHARES = {"null": 0.25, "single": 0.40, "instrument": 0.35}
READERS = ("world camera", "tip camera", "pose", "distance", "socket")
_ARM = ("joint_offset", "transmission_harmonic", "backlash", "joint_coupling", "joint_compliance")
_LENS = ("focal_scale", "focal_drift", "focal_expansion", "board_scale", "moved")
_FAULTS = {"world camera": _LENS, "tip camera": _LENS, "socket": ("step", "socket_seat")}
_NONCENTRALITY = (60.0, 3000.0)
_NARROW = 0.12  # of the joints' ranges: a board in the world stays before a camera on the tip
_FEWEST = 50  # readings of a fit
_LARGEST = {"focal_scale": 0.03, "board_scale": 0.03, "focal_drift": 3e-3, "focal_expansion": 8e-4}
_PIXEL, _BODY = 0.2, (8e-5, 2e-4)  # px; m and rad, of each coordinate
_ROUNDS, _CLOSER, _NEAR = 10, 6, 1e-4  # m: from there contact is reached


@dataclass(frozen=True, eq=False)
class Fault:
    """What is wrong with an instrument, of size one: the parameter, or metres and radians.

    where : names in the answers, any of which is right
    """

    effect: str
    where: tuple[str, ...]
    motion: Array
    size: float = 1.0

    def on(self, scene: Scene, site: Sites) -> tuple[Array, float, Array, Array]:
        """The last four fields of a :class:`View`."""
        count, session, none = scene.count, scene.session, np.zeros(scene.count)
        of_focus = {
            "focal_scale": np.ones(count),
            "focal_drift": session.hours,
            "focal_expansion": session.temperature - 20.0,
        }
        there = (site == 1) | ("socket" not in self.where[0])
        late = there & (np.arange(count) >= 0.5 * count)
        return (
            self.size * of_focus.get(self.effect, none),
            self.size * (self.effect == "board_scale"),
            np.outer(late * (self.effect in ("step", "moved")), self.size * self.motion),
            np.outer(there * (self.effect == "socket_seat"), self.size * self.motion[:3]),
        )


Wrong = Cause | Fault


@dataclass(frozen=True, eq=False)
class Sensed:
    """A case. rows : ndarray, shape (N, C, r), what the table shows, NaN where it shows nothing."""

    family: str
    kind: str
    scene: Scene
    reader: Reader
    cause: Wrong | None
    noncentrality: float
    rows: Array
    site: Sites


def draw_sensed(rng: np.random.Generator, family: str, kind: str = "") -> Sensed:
    """A case of one family, read by a kind of reader if it is named."""
    kinds = (kind,) if kind else tuple(_FAULTS) if family == "instrument" else READERS
    while True:
        try:
            return _filled(rng, family, str(rng.choice(kinds)))
        except Unsuitable:
            continue


def _filled(rng: np.random.Generator, family: str, kind: str) -> Sensed:
    scene = draw_scene(rng, ARMS[int(rng.integers(2))], Conditions(known_geometry=True)).rigid()
    if kind == "tip camera":
        q = scene.session.q
        near = np.radians(np.round(np.degrees(q[0] + _NARROW * (q - q[0])), 6))
        scene = _driven(scene, near)
    mechanism = scene.mechanism()
    reader = _placed(rng, kind, scene, mechanism)
    site = np.arange(scene.count) % 4
    cause, there = _drawn(rng, family, kind, scene, reader), np.ones(scene.count, dtype=bool)
    if isinstance(reader, Nests):
        scene = _reached(scene, mechanism, reader, site)
        _, off = _toward_contact(mechanism, reader, site, scene.session.q)
        there = np.linalg.norm(off, axis=1) < _NEAR
    day, reached = Day(scene, mechanism, reader, site, there), 0.0
    if cause is not None:
        cause, reached = _sized(rng, day, cause)
    if isinstance(reader, Nests):
        scene, there = _in_contact(rng, day, reader, cause)
        rows = np.where(there, 0.0, np.nan)[:, None, None]
    else:
        rows = reader.noisy(rng, day.rows(cause))
    read = np.isfinite(rows).all(axis=-1).sum(axis=1) > 0
    if np.count_nonzero(read & ~scene.session.held) < _FEWEST:
        raise Unsuitable
    return Sensed(family, kind, scene, reader, cause, reached, rows, site)


def _driven(scene: Scene, q: Array) -> Scene:
    return replace(scene, session=replace(scene.session, q=q))


@dataclass(frozen=True, eq=False)
class Day:
    """What the reader reads of the scene, with a cause or without.

    there : ndarray of bool, shape (N,), where it can
    """

    scene: Scene
    mechanism: Mechanism
    reader: Reader
    site: Sites
    there: Mask

    def view(self, cause: Wrong | None) -> View:
        """The tip, and what is wrong with the reader."""
        scene, on_arm = self.scene, [cause] if isinstance(cause, Cause) else []
        state = at_rest(scene, self.mechanism, on_arm)
        fault = cause if isinstance(cause, Fault) else Fault("", ("",), np.zeros(6))
        wrong = fault.on(scene, self.site)
        return View(state.R_link[:, -1], state.o[:, -1], self.site, *wrong)

    def rows(self, cause: Wrong | None) -> Array:
        """Readings without noise."""
        reader = self.reader
        return reader.rows(self.view(cause), np.zeros(reader.places), np.zeros(reader.tips))

    def noncentrality(self, cause: Wrong) -> float:
        """Of what the cause does, beside an unknown place and an unknown tip, at the fitted poses."""
        view, reader = self.view(None), self.reader
        fitted = self.there & ~self.scene.session.held

        def read(x: Array) -> Array:
            return reader.rows(view, x[: reader.places], x[reader.places :])

        unknown = reader.places + reader.tips
        steps = 1e-6 * np.eye(unknown)
        columns = [reader.off(read(h), read(-h))[fitted].ravel() / 2e-6 for h in steps]
        moved = reader.off(self.rows(cause), read(np.zeros(unknown)))[fitted].ravel()
        J = np.column_stack(columns)
        seen = np.isfinite(moved) & np.isfinite(J).all(axis=1)
        if seen.sum() < 2 * unknown:
            raise Unsuitable
        left = moved[seen] - J[seen] @ np.linalg.lstsq(J[seen], moved[seen], rcond=None)[0]
        return float(left @ left)


def _placed(rng: np.random.Generator, kind: str, scene: Scene, mechanism: Mechanism) -> Reader:
    """Where the reader is and what it reads, so that it can."""
    state = at_rest(scene, mechanism, ())
    R, p, tool = state.R_link[:, -1], state.o[:, -1], scene.arm.tool
    on = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3) * tool
    middle = p.mean(axis=0)
    reach = float(np.linalg.norm(p - middle, axis=1).max())
    away = rng.normal(size=3)
    away = away / np.linalg.norm(away)
    if kind == "world camera":
        eye = middle + 3.0 * reach * away
        shape = rng.uniform(-1.0, 1.0, (9, 3)) * tool
        return Camera(_toward(rng, -away), eye, *on, _PIXEL, shape, rides=False)
    if kind == "tip camera":
        ahead = R[0] @ on[0], p[0] + R[0] @ (on[1] + on[0] @ [0.0, 0.0, 8.0 * tool])
        flat = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) - [2.0, 1.5, 0.0]
        tilt = rotation(np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3.0, 3.0)]))
        return Camera(*on, ahead[0] @ tilt, ahead[1], _PIXEL, flat * 0.6 * tool, rides=True)
    frame = Rotation.random(rng=rng).as_matrix(), middle + 2.5 * reach * away
    if kind == "pose":
        return Bodies(*frame, *on, *_BODY)
    ball = rng.uniform(0.4, 1.0, 3) * tool
    guess, sigma = ball + rng.normal(size=3) * 3e-3, 3.0 * scene.arm.sigma
    if kind == "distance":
        return Wire(*frame, on[0], ball, sigma, guess)
    centres = (p + R @ ball)[rng.permutation(scene.count)[:4]]
    return Nests(*frame, on[0], ball, sigma, guess, centres)


def _toward(rng: np.random.Generator, z: Array) -> Array:
    """Axes of a camera that looks along z."""
    x = np.cross(z, rng.normal(size=3))
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _drawn(
    rng: np.random.Generator, family: str, kind: str, scene: Scene, reader: Reader
) -> Wrong | None:
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


def _sized(rng: np.random.Generator, day: Day, cause: Wrong) -> tuple[Wrong, float]:
    """The cause at a noncentrality drawn evenly in its logarithm. Raises Unsuitable."""
    wanted = float(np.exp(rng.uniform(*np.log(_NONCENTRALITY))))
    if isinstance(cause, Fault) and cause.effect in _LARGEST:
        cause = replace(cause, size=0.1 * _LARGEST[cause.effect] * float(rng.choice([-1.0, 1.0])))
    for _ in range(4):
        try:
            reached = day.noncentrality(cause)
        except RuntimeError:
            raise Unsuitable from None
        factor = float(np.sqrt(wanted / max(reached, 1e-9)))
        if abs(factor - 1.0) < 0.02:
            return cause, reached
        cause = replace(cause, size=cause.size * factor)
        if _absurd(cause):
            raise Unsuitable
    raise Unsuitable


def _absurd(cause: Wrong) -> bool:
    if isinstance(cause, Fault):
        return abs(cause.size) > _LARGEST.get(cause.effect, 10.0)
    return max(abs(v * cause.size) for v in cause.values.values()) > 3e-3


# -- a ball in its sockets -------------------------------------------------------------------------


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


def _back(follow: Array, off: Array) -> Array:
    """A step of the joints, at most 0.3 rad, that takes the ball back."""
    step = -(follow @ off[..., None])[..., 0]
    largest = np.maximum(np.abs(step).max(axis=1), 1e-12)
    return np.asarray(step * np.minimum(1.0, 0.3 / largest)[:, None])


def _reached(scene: Scene, mechanism: Mechanism, reader: Touching, site: Sites) -> Scene:
    """The scene with joints at which a rigid arm without causes has the ball in its sockets."""
    q = scene.session.q.copy()
    for _ in range(_ROUNDS):
        q = q + _back(*_toward_contact(mechanism, reader, site, q))
    return _driven(scene, q)


def _in_contact(
    rng: np.random.Generator, day: Day, reader: Touching, cause: Wrong | None
) -> tuple[Scene, Mask]:
    """The scene with joints at which the ball is in its socket, but for noise, and where that is so."""
    scene, q = day.scene, day.scene.session.q.copy()
    noise = rng.normal(scale=reader.sigma, size=(scene.count, 3))
    follow, _ = _toward_contact(day.mechanism, reader, day.site, q)
    for _ in range(_CLOSER):
        here = _driven(scene, q)
        off = replace(day, scene=here).rows(cause)[:, 0] - noise
        there = np.linalg.norm(off, axis=1) < 1e-7
        q = q + np.where(there[:, None], 0.0, _back(follow, off))
    low, high = scene.arm.limits.T
    return here, there & ((q > low) & (q < high)).all(axis=1)
