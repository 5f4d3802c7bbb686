"""One scene: an arm with its true parameters, noise, scatter, what the user believes, and a session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.truth.arms import Arm, Array, Mask
from studies.research.truth.conditions import PAIRED, Conditions
from studies.research.truth.mechanism import Action, G, Mechanism, State
from studies.research.truth.noise import Noise, Scatter, growing, scatter_of
from studies.research.truth.session import Session, draw_session

HELD_OUT = 20  # configurations
RATIO = (50, 160)
"""Motor turns a turn of a joint."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything but the causes.

    geometry : ndarray, shape (n + 2, 6), m and rad, true displacement of each frame
    markers, guesses : ndarray, shape (M, 3), m, true and believed, tip frame
    compliance : ndarray, shape (n,), rad/(N m), of the joints that truly yield, all of them modelled
    modelled : names of the joints whose compliance is in the user's model
    payload : kg known to the user, com : ndarray, shape (3,), m, tip frame
    knots : joint name -> ndarray, rad, as the cell gives them
    noise, believed : of the instrument, true and as the cell says it
    R, p : placement of the base in the instrument's frame
    wrench : ndarray, shape (N, 6), N and N m, as the file shows it, about the tip's origin, base axes
    scatter : of the arm from approach to approach, None where it repeats exactly
    repeatability : as the cell says it, of one coordinate of the tip, m and rad, or None
    measured : ndarray, shape (N, n), N m, torques that the file shows, or None
    ratios : motor turns a turn of each joint that turns
    """

    arm: Arm
    conditions: Conditions
    session: Session
    geometry: Array
    markers: Array
    guesses: Array
    compliance: Array
    modelled: tuple[str, ...]
    payload: float
    com: Array
    knots: dict[str, Array]
    noise: Noise
    believed: Noise
    R: Array
    p: Array
    wrench: Array
    scatter: Scatter | None = None
    repeatability: tuple[float, float] | None = None
    measured: Array | None = None
    ratios: dict[str, int] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of readings, N."""
        return len(self.session)

    @property
    def clock(self) -> Array:
        """Time since the first reading, shape (N,), s; readings where the file has no time.

        Of a hold-out that was read by itself nothing tells when: long after the others.
        """
        if "time" in self.conditions.columns:
            return self.session.hours * 3600.0
        late = 0.0 if self.session.pause is None else 3.0 * self.session.pause
        return np.arange(self.count) + late * self.session.held

    @property
    def fitted_clock(self) -> Array:
        """The clock of the readings that are fitted, in order, s or readings."""
        return self.clock[~self.session.held]

    def joint(self, name: str) -> Array:
        """One joint as it is read, shape (N,), rad or m."""
        return self.session.q[:, self.index(name)]

    def index(self, name: str) -> int:
        """Position of a joint, 0 .. n - 1; its frame is the next number."""
        return self.arm.names.index(name)

    def mechanism(self) -> Mechanism:
        """The true arm in MuJoCo."""
        return Mechanism(self.arm, self.geometry, self.markers, self.conditions.weighs)

    def rigid(self) -> Scene:
        """The same without drives that yield."""
        return replace(self, compliance=self.compliance * 0.0, modelled=(), knots={})

    def nothing(self) -> Action:
        """An action of zeros to write into."""
        return Action.none(self.arm, self.count, len(self.markers))

    def only(self, slot: str, at: Any, value: Array) -> Action:
        """An action of one slot: joint, twist, load, marker or reading."""
        action = self.nothing()
        getattr(action, slot)[at] = value
        return action

    def known(self, state: State) -> Action:
        """What the user's model has as well: loads and compliances."""
        action = self.nothing()
        action.load[:, -1] += self.wrench
        action.load[:, -1] += hung(state.R_link[:, -1], self.payload, self.com)
        action.joint[:] = self.compliance * state.torque
        return action


def hung(R: Array, mass: float, at: Array) -> Array:
    """Force and moment of a mass about the origin of its frame, base axes, shape (N, 6).

    R : ndarray, shape (N, 3, 3); at : ndarray, shape (3,), m, in the frame
    """
    force = np.array([0.0, 0.0, -G * mass])
    moment = np.cross(R @ at, force)
    return np.concatenate([np.broadcast_to(force, moment.shape), moment], axis=-1)


class Acting(Protocol):
    """Anything that moves the arm: a cause, or the arm's scatter."""

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""


def at_rest(scene: Scene, mechanism: Mechanism, causes: Sequence[Acting]) -> State:
    """The arm under the known loads and some causes."""

    def act(state: State) -> Action:
        action = scene.known(state)
        for cause in causes:
            cause.add_to(action, scene, state)
        return action

    return mechanism.rest(scene.session.q, act, (scene.R, scene.p))


def draw_scene(rng: np.random.Generator, arm: Arm, conditions: Conditions) -> Scene:
    """The arm's true parameters, the user's model of it, and the session; nothing scatters yet."""
    session = draw_session(rng, arm, conditions, HELD_OUT)
    geometry = np.zeros((arm.dof + 2, 6))
    if not conditions.known_geometry:
        geometry[1:, :3] = rng.normal(size=(arm.dof + 1, 3)) * 3e-4
        geometry[1:, 3:] = rng.normal(size=(arm.dof + 1, 3)) * 4e-4
    soft = np.flatnonzero([joint.compliance for joint in arm.joints])
    stiff = rng.permutation(soft)[: int(rng.choice(3, p=[0.5, 0.25, 0.25]))]
    compliance = np.array([j.compliance for j in arm.joints]) * rng.lognormal(0.0, 0.25, arm.dof)
    compliance[stiff] = 0.0
    guesses = _markers(rng, arm)
    payload = round(float(rng.uniform(0.3, 1.0)) * arm.payload, 2) if conditions.payload else 0.0
    com = np.round(rng.uniform(-0.4, 0.4, 3) * arm.tool, 4) if payload else np.zeros(3)
    knots = _knots(arm) if rng.random() < 0.7 else {}
    stated = growing(rng, arm.sigma) if conditions.range_noise else Noise.uniform(arm.sigma)
    R = Rotation.random(rng=rng).as_matrix()
    away = rng.normal(size=3)
    scene = Scene(
        arm=arm,
        conditions=conditions,
        session=session,
        geometry=geometry,
        markers=guesses + rng.normal(size=guesses.shape) * 1e-3,
        guesses=guesses,
        compliance=compliance,
        modelled=tuple(arm.names[k] for k in soft if compliance[k]),
        payload=payload,
        com=com,
        knots=knots,
        noise=stated.times(1.5) if conditions.wrong_sigma else stated,
        believed=Noise.uniform(arm.sigma) if conditions.range_noise == "unsaid" else stated,
        R=R,
        p=float(rng.uniform(3.0, 6.0)) * away / np.linalg.norm(away),
        wrench=_wrench(arm, session),
    )
    return scene if conditions.visit == PAIRED else _with_drives(rng, scene)


def _with_drives(rng: np.random.Generator, scene: Scene) -> Scene:
    """The scene with gear ratios and measured torques, of one reflector where so drawn."""
    if scene.conditions.one_marker:
        scene = replace(scene, markers=scene.markers[:1], guesses=scene.guesses[:1])
    ratios = {name: int(rng.integers(*RATIO, endpoint=True)) for name in scene.arm.turning}
    scene = replace(scene, ratios=ratios)
    return replace(scene, measured=_measured(rng, scene)) if scene.conditions.torques else scene


def _measured(rng: np.random.Generator, scene: Scene) -> Array:
    """Torques as the drives show them, rounded as in the file: load, weight, friction, offset, noise.

    The links weigh here even where the user does not know it.
    """
    whole = Mechanism(scene.arm, scene.geometry, scene.markers)
    torque = at_rest(scene, whole, ()).torque
    scale = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-3)
    friction = rng.uniform(0.1, 0.4, scene.arm.dof) * scale * scene.session.approach
    offset = rng.normal(size=scene.arm.dof) * 0.1 * scale
    noise = rng.normal(size=torque.shape) * 0.03 * scale
    return np.asarray(np.round(torque + friction + offset + noise, 4) + 0.0)


def _markers(rng: np.random.Generator, arm: Arm) -> Array:
    """Three or four reflectors about the tool, well out of line, mm as the cell shows them."""
    count = int(rng.choice([3, 4], p=[0.8, 0.2]))
    return reflectors(rng, arm, count, (0.3, 0.6), (0.6, 1.1))


def reflectors(
    rng: np.random.Generator,
    arm: Arm,
    count: int,
    across: tuple[float, float],
    along: tuple[float, float],
) -> Array:
    """Reflectors around the tool's axis at uneven heights, shape (count, 3), m; shares of the tool."""
    turn = rng.uniform(0, 2 * np.pi) + np.arange(count) * 2 * np.pi / count
    beside = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(*across)
    return np.round(np.hstack([beside, rng.uniform(*along, (count, 1))]) * arm.tool, 4)


def _knots(arm: Arm) -> dict[str, Array]:
    """Five angles of each joint that turns, rounded as the cell shows them."""
    even = {j.name: np.linspace(j.low, j.high, 5) for j in arm.joints if not j.slides}
    return {name: np.radians(np.round(np.degrees(knots), 4)) for name, knots in even.items()}


def _wrench(arm: Arm, session: Session) -> Array:
    """Hung load about the nominal tip's origin, as a force sensor would give it, base axes, (N, 6)."""
    mechanism = Mechanism(arm, np.zeros((arm.dof + 2, 6)), np.zeros((1, 3)), weighs=False)
    R = mechanism.posed(session.q).R_link[:, -1]
    moment = np.cross(R @ session.hang, session.force)
    return np.asarray(np.hstack([session.force, moment]).round(4) + 0.0)  # no minus zeros


def with_scatter(
    rng: np.random.Generator,
    scene: Scene,
    still: State,
    ratio: tuple[float, float],
    in_joints: float,
) -> Scene:
    """The scene with an arm that scatters by a ratio to the instrument; the cell may say it.

    in_joints : share of the arms that scatter in their joints, the others at the tip
    """
    shape = scatter_of(rng, scene.arm, still, in_joints=rng.random() < in_joints)
    everywhere: Mask = np.ones(still.readings.shape[:2], dtype=bool)
    wanted = np.exp(rng.uniform(*np.log(ratio))) * scene.noise.rms(still.readings, everywhere)
    reached = np.sqrt(np.mean(shape.squares(scene.arm, still)))
    scatter = shape.times(float(wanted / reached))
    said = scatter.repeatability(scene.arm, still) if rng.random() < 0.5 else None
    return replace(scene, scatter=scatter, repeatability=said)
