"""An arm that does not repeat exactly: one draw for each approach, free and loaded alike."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.actions import Action, State, frame_columns
from studies.research.withheld.robots import Arm, Array

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
