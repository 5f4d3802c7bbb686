"""One scene: an arm with its true parameters, what the user believes of it, and a session."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from studies.research.withheld.actions import Action, State
from studies.research.withheld.noise import Noise
from studies.research.withheld.robots import Arm, Array
from studies.research.withheld.scatter import Scatter
from studies.research.withheld.session import Session
from studies.research.withheld.texts import G
from studies.research.withheld.truth import Mechanism


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
