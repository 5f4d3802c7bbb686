"""Further causes that no catalogue holds: two jumps at once, a walk, a cable, a lag that saturates."""

from __future__ import annotations

import numpy as np

from studies.research.withheld.actions import Action, State
from studies.research.withheld.outside import Outside
from studies.research.withheld.real.effects import AXES, Values, displaced, step
from studies.research.withheld.scene import Scene


def two_jumps(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A collision: the joint's zero and the base jump at the same moment."""
    action = step(scene, state, where, values)
    action.add(step(scene, state, "base", values), np.ones(scene.count))
    return action


def random_walk(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A base that wanders by independent steps from reading to reading; ``seed`` says which way."""
    rng = np.random.default_rng(int(values["seed"]))
    steps = rng.normal(size=(scene.count, 6)) * [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    action = scene.nothing()
    for c, name in enumerate(AXES):
        walk = np.cumsum(steps[:, c]) * values["a"]
        action.add(displaced(scene, state, where, {name: 1.0}, walk), np.ones(scene.count))
    return action


def cable_force(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A spring between the tip and a point fixed in the base frame, slack nowhere; ``a`` in N/m."""
    anchor = np.array([values["x"], values["y"], values["z"]])
    action = scene.nothing()
    action.load[:, -1, :3] = values["a"] * (anchor - state.o[:, -1])
    return action


def saturating_lag(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A joint that lags by its last move up to ``b`` [rad or m], and by no more after longer ones."""
    k = scene.arm.names.index(where)
    action = scene.nothing()
    action.joint[:, k] = -values["a"] * np.tanh(scene.session.moves[:, k] / values["b"])
    return action


BEYOND: dict[str, Outside] = {
    "two_jumps": Outside(two_jumps, ("time",)),
    "random_walk": Outside(random_walk, ("time",)),
    "cable_force": Outside(cable_force, ("load", "pose")),
    "saturating_lag": Outside(saturating_lag, ("motion:{k}", "approach:{k}")),
}
