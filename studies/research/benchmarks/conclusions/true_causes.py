"""A true cause: what it does to the arm, how large it is, and the names that are right for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from studies.research.withheld.actions import Action, State
from studies.research.withheld.match import Entry
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene

Act = Callable[[Scene, State], Action]


@dataclass(frozen=True, eq=False)
class TrueCause:
    """Linear in its size.

    kind : formula; where : place; act : what it does at size one
    names : effects that are the right answer, each as a key of the sealed cases has them
    """

    kind: str
    where: str
    act: Act
    names: tuple[Entry, ...]
    size: float = 1.0

    def sized(self, factor: float) -> TrueCause:
        """The same, so many times as large."""
        return replace(self, size=self.size * factor)

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        action.add(self.act(scene, state), np.full(scene.count, self.size))


def named(where: str, *effects: str) -> tuple[Entry, ...]:
    """Effects at one place."""
    return tuple({"effect": effect, "where": where} for effect in effects)


def tuned(entry: Entry, name: str, value: float, unit: str, tolerance: float) -> Entry:
    """The same, right only where a parameter is near enough."""
    near = {"name": name, "value": value, "unit": unit, "tolerance": tolerance}
    return {**entry, "tuned": near}


def joint_error(k: int, dq: Callable[[Scene, State], Array]) -> Act:
    """What turns or shifts joint k by dq, shape (N,), rad or m."""

    def act(scene: Scene, state: State) -> Action:
        action = scene.nothing()
        action.joint[:, k] = dq(scene, state)
        return action

    return act


def base_motion(twist: Array, by: Callable[[Scene], Array]) -> Act:
    """What moves the base by a twist (6,), m and rad, times ``by``, shape (N,)."""

    def act(scene: Scene, state: State) -> Action:  # noqa: ARG001
        action = scene.nothing()
        action.twist[:, 0] = np.outer(by(scene), twist)
        return action

    return act


def ripple_names(scene: Scene, k: int, cycles: float) -> tuple[Entry, ...]:
    """A ripple of joint k, found where its cycles are within two widths of a spectral line."""
    line = 2.0 * np.pi / float(np.ptp(scene.session.q[:, k]))
    (entry,) = named(scene.arm.names[k], "gear_ripple")
    return (tuned(entry, "cycles", cycles, "1/turn", 2.0 * line),)
