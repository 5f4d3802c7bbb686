"""One scene: an arm with its true parameters, noise, scatter, what the user believes, and a session."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.session import Session
from studies.research.withheld.truth import Action, G, Mechanism, State, frame_columns

MIDDLE = 4.5  # m, from the instrument to the middle of the cell
_STEP = 1e-7  # m and m/m: standard deviations are rounded as the cell shows them


@dataclass(frozen=True)
class Noise:
    """Standard deviations along the beam, and in each direction across it, from the instrument.

    along, across : m; across_per_m : m/m, by which the latter grows with range
    """

    along: float
    across: float
    across_per_m: float = 0.0

    @classmethod
    def uniform(cls, sigma: float) -> Noise:
        """The same [m] in every direction at any range."""
        return cls(sigma, sigma)

    @property
    def grows(self) -> bool:
        """Whether range and direction matter."""
        return self.across_per_m > 0.0 or self.along != self.across

    @property
    def sigma(self) -> float:
        """Root mean square of one coordinate in the middle of the cell, m."""
        if not self.grows:
            return self.along
        across = self.across + self.across_per_m * MIDDLE
        return float(np.sqrt((self.along**2 + 2.0 * across**2) / 3.0))

    def times(self, factor: float) -> Noise:
        """The same law at another size."""
        return Noise(self.along * factor, self.across * factor, self.across_per_m * factor)

    def coloured(self, normal: Array, points: Array) -> Array:
        """Standard normal vectors (..., 3) with the covariance of each point (..., 3), m."""
        return self._scaled(normal, points, 1.0)

    def whitened(self, moved: Array, points: Array) -> Array:
        """Vectors (..., 3), m, at points (..., 3), m, in standard deviations."""
        return self._scaled(moved, points, -1.0)

    def rms(self, points: Array, seen: NDArray[np.bool_]) -> float:
        """3-D root mean square over the points seen, m: the floor that no model gets below."""
        if not self.grows:
            return float(np.sqrt(3.0)) * self.along
        across = self.across + self.across_per_m * np.linalg.norm(points[seen], axis=-1)
        return float(np.sqrt(self.along**2 + 2.0 * np.mean(across**2)))

    def _scaled(self, vectors: Array, points: Array, power: float) -> Array:
        away = np.linalg.norm(points, axis=-1, keepdims=True)
        beam = points / away
        along = beam * np.sum(beam * vectors, axis=-1, keepdims=True)
        across = np.power(self.across + self.across_per_m * away, power)
        scaled: Array = along * np.power(self.along, power) + (vectors - along) * across
        return scaled


def growing(rng: np.random.Generator, sigma: float) -> Noise:
    """A tracker's law: good distances, angles that cost the more the farther the point.

    sigma : m, typical; between two and eight metres the error across grows two- to threefold
    """
    drawn = sigma * rng.uniform((0.3, 0.2, 0.12), (0.8, 0.5, 0.24))
    return Noise(*(float(v) for v in np.round(drawn / _STEP) * _STEP))


RATIO = (1.0, 3.0)
"""3-D RMS at the markers over the instrument's, drawn evenly in the logarithm."""
_LEVER = (0.15, 1.0)  # m, standard deviation of the tip's place over that of a rotation, the same


@dataclass(frozen=True, eq=False)
class Scatter:
    """Independent normal displacements of an arm, the same as long as it stays.

    joints : ndarray, shape (n,), standard deviations, rad or m
    tip : ndarray, shape (6,), those of the tip frame along and about its own axes, m and rad
    """

    joints: Array
    tip: Array

    @property
    def std(self) -> Array:
        """All standard deviations, shape (n + 6,)."""
        return np.concatenate([self.joints, self.tip])

    def times(self, factor: float) -> Scatter:
        """The same, so many times as large."""
        return Scatter(self.joints * factor, self.tip * factor)

    def columns(self, arm: Arm, state: State) -> Array:
        """Displacement of the points by one standard deviation of each, (N, M, 3, n + 6), base axes."""
        own = [
            frame_columns(state, k + 1)[..., slice(0, 3) if joint.slides else slice(3, 6)] @ axis
            for k, (joint, axis) in enumerate(zip(arm.joints, arm.axes, strict=True))
        ]
        unit = np.concatenate([np.stack(own, axis=-1), frame_columns(state, arm.dof + 1)], axis=-1)
        return np.asarray(unit * self.std)

    def squares(self, arm: Arm, state: State) -> Array:
        """Expected squared distance by which each point scatters, shape (N, M), m^2."""
        return np.asarray(np.sum(self.columns(arm, state) ** 2, axis=(-2, -1)))

    def repeatability(self, arm: Arm, state: State) -> tuple[float, float]:
        """Standard deviation of one coordinate of the tip, m, and of one component of its turn, rad.

        Root mean squares over the readings of a state.
        """
        at_tip = replace(state, points=state.o[:, -1:])
        turns = np.concatenate([self.joints[~arm.slides], self.tip[3:]])
        place = np.sqrt(np.mean(self.squares(arm, at_tip)) / 3.0)
        return float(place), float(np.sqrt(np.sum(turns**2) / 3.0))

    def drawn(self, rng: np.random.Generator, visit: NDArray[np.int_]) -> Wander:
        """One draw for each visit; visit : ndarray, shape (N,), counts the approaches."""
        each = rng.normal(size=(int(visit.max()) + 1, len(self.std))) * self.std
        joint, tip = np.split(each[visit], [len(self.joints)], axis=1)
        return Wander(joint, tip)


@dataclass(frozen=True, eq=False)
class Wander:
    """Where the arm stood off at N readings: joint (N, n), rad or m; tip (N, 6), m and rad."""

    joint: Array
    tip: Array

    def add_to(self, action: Action, scene: object, state: object) -> None:  # noqa: ARG002
        """Add it, whatever the load."""
        action.joint[:] += self.joint
        action.twist[:, -1] += self.tip


def scatter_of(rng: np.random.Generator, arm: Arm, state: State, in_joints: bool) -> Scatter:
    """A plausible arm of no particular size: joints of like effect at the markers, or a loose tip."""
    none = Scatter(np.zeros(arm.dof), np.zeros(6))
    if not in_joints:
        lever = float(np.exp(rng.uniform(*np.log(_LEVER))))
        return replace(none, tip=np.repeat([1.0, 1.0 / lever], 3))
    unit = replace(none, joints=np.ones(arm.dof)).columns(arm, state)[..., : arm.dof]
    lever = np.sqrt(np.mean(np.sum(unit**2, axis=-2), axis=(0, 1)))
    # Between equal angles and equal effects: drives near the base are the better ones.
    return replace(none, joints=rng.lognormal(0.0, 0.5, arm.dof) / np.sqrt(lever))


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything but the effects.

    geometry : ndarray, shape (n + 2, 6), m and rad, true displacement of each frame
    markers, guesses : ndarray, shape (M, 3), m, true and believed, tip frame
    compliance : ndarray, shape (n,), rad/(N m), of the joints that truly yield, all of them modelled
    modelled : names of the joints whose compliance is in the user's model
    known_geometry : the model has no geometry and the truth none either
    weighs : link masses stand in the URDF, and the links have them
    payload : kg known to the user, com : ndarray, shape (3,), m, tip frame
    columns : which of time, temperature, approach the files show
    knots : joint name -> ndarray, rad, as the cell gives them
    noise, believed : of the instrument, true and as the cell says it
    R, p : placement of the base in the instrument's frame
    wrench : ndarray, shape (N, 6), N and N m, as the file shows it, about the tip's origin, base axes
    scatter : of the arm from approach to approach, None where it repeats exactly
    repeatability : as the cell says it, of one coordinate of the tip, m and rad, or None
    measured : ndarray, shape (N, n), N m, torques that the file shows, or None
    ratios : motor turns a turn of each joint that turns; ratios_said : the cell gives them
    """

    arm: Arm
    session: Session
    geometry: Array
    markers: Array
    guesses: Array
    compliance: Array
    modelled: tuple[str, ...]
    known_geometry: bool
    weighs: bool
    payload: float
    com: Array
    columns: frozenset[str]
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
    ratios_said: bool = False

    @property
    def clock(self) -> Array:
        """Time since the first reading, shape (N,), s; readings where the file has no time.

        Of a hold-out that was read by itself nothing tells when: long after the others.
        """
        if "time" not in self.columns:
            late = 0.0 if self.session.pause is None else 3.0 * self.session.pause
            return np.arange(self.count) + late * self.session.held
        return self.session.hours * 3600.0

    @property
    def count(self) -> int:
        """Number of readings, N."""
        return len(self.session)

    def mechanism(self) -> Mechanism:
        """The true arm in MuJoCo."""
        return Mechanism(self.arm, self.geometry, self.markers, self.weighs)

    def nothing(self) -> Action:
        """An action of zeros to write into."""
        return Action.none(self.arm, self.count, len(self.markers))

    def known(self, state: State) -> Action:
        """What the user's model holds as well: loads and compliances."""
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
