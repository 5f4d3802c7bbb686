"""Noise of the instrument by range and direction, and an arm that scatters between approaches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from studies.research.truth.arms import Arm, Array, Mask
from studies.research.truth.mechanism import Action, State, frame_columns

_MIDDLE = 4.5  # m, from the instrument to the middle of the cell
_STEP = 1e-7  # m and m/m: standard deviations are rounded as the cell shows them
_LEVER = (0.15, 1.0)  # m, standard deviation of the tip's place over that of a rotation


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
        across = self.across + self.across_per_m * _MIDDLE
        return float(np.sqrt((self.along**2 + 2.0 * across**2) / 3.0)) if self.grows else self.along

    def times(self, factor: float) -> Noise:
        """The same law at another size."""
        return Noise(self.along * factor, self.across * factor, self.across_per_m * factor)

    def coloured(self, normal: Array, points: Array) -> Array:
        """Standard normal vectors (.., 3) with the covariance of each point (.., 3), m."""
        return self._scaled(normal, points, 1.0)

    def whitened(self, moved: Array, points: Array) -> Array:
        """Vectors (.., 3), m, at points (.., 3), m, in standard deviations."""
        return self._scaled(moved, points, -1.0)

    def rms(self, points: Array, seen: Mask) -> float:
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
        return np.asarray(along * np.power(self.along, power) + (vectors - along) * across)


def growing(rng: np.random.Generator, sigma: float) -> Noise:
    """A tracker's law: good distances, angles that cost the more the farther the point.

    sigma : m, typical; between two and eight metres the error across grows two- to threefold
    """
    drawn = sigma * rng.uniform((0.3, 0.2, 0.12), (0.8, 0.5, 0.24))
    return Noise(*(float(v) for v in np.round(drawn / _STEP) * _STEP))


@dataclass(frozen=True, eq=False)
class Wander:
    """Where the arm stood off at N readings: joint (N, n), rad or m; tip (N, 6), m and rad."""

    joint: Array
    tip: Array

    def add_to(self, action: Action, scene: object, state: object) -> None:
        """Add it, whatever the load."""
        del scene, state
        action.joint[:] += self.joint
        action.twist[:, -1] += self.tip


@dataclass(frozen=True, eq=False)
class Scatter:
    """Independent normal displacements of an arm, the same as long as it stays.

    joints : ndarray, shape (n,), standard deviations, rad or m
    tip : ndarray, shape (6,), those of the tip frame along and about its axes, m and rad
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
        turned = [
            frame_columns(state, k + 1)[..., slice(0, 3) if joint.slides else slice(3, 6)] @ axis
            for k, (joint, axis) in enumerate(zip(arm.joints, arm.axes, strict=True))
        ]
        tip = frame_columns(state, arm.dof + 1)
        return np.asarray(np.concatenate([np.stack(turned, axis=-1), tip], axis=-1) * self.std)

    def squares(self, arm: Arm, state: State) -> Array:
        """Expected squared distance by which each point scatters, shape (N, M), m^2."""
        return np.asarray(np.sum(self.columns(arm, state) ** 2, axis=(-2, -1)))

    def at_tip(self, arm: Arm, state: State) -> float:
        """3-D root mean square of the tip's place over the readings of a state, m."""
        tip = replace(state, points=state.o[:, -1:])
        return float(np.sqrt(np.mean(self.squares(arm, tip))))

    def repeatability(self, arm: Arm, state: State) -> tuple[float, float]:
        """Standard deviation of one coordinate of the tip, m, and of one component of its turn, rad."""
        turns = np.concatenate([self.joints[~arm.slides], self.tip[3:]])
        place = self.at_tip(arm, state) / np.sqrt(3.0)
        return float(place), float(np.sqrt(np.sum(turns**2) / 3.0))

    def drawn(self, rng: np.random.Generator, visit: NDArray[np.int_]) -> Wander:
        """One draw for each visit; visit : ndarray, shape (N,), counts the approaches."""
        each = rng.normal(size=(int(visit.max()) + 1, len(self.std))) * self.std
        return Wander(*np.split(each[visit], [len(self.joints)], axis=1))


def scatter_of(rng: np.random.Generator, arm: Arm, state: State, in_joints: bool) -> Scatter:
    """A plausible arm of no particular size: joints of like effect at the markers, or a loose tip."""
    none = Scatter(np.zeros(arm.dof), np.zeros(6))
    if not in_joints:
        lever = float(np.exp(rng.uniform(*np.log(_LEVER))))
        return replace(none, tip=np.repeat([1.0, 1.0 / lever], 3))
    unit = replace(none, joints=np.ones(arm.dof)).columns(arm, state)[..., : arm.dof]
    effect = np.sqrt(np.mean(np.sum(unit**2, axis=-2), axis=(0, 1)))
    # Between equal angles and equal effects: drives near the base are the better ones.
    return replace(none, joints=rng.lognormal(0.0, 0.5, arm.dof) / np.sqrt(effect))
