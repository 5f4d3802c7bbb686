"""Causes that no catalogue holds."""

from __future__ import annotations

import numpy as np

from studies.research.withheld.effects import AXES, Effect, Values, displaced, index, step, turned
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Action, State


def marker_drift(scene: Scene, state: State, where: str, values: Values) -> Action:
    """One reflector creeps out of its nest."""
    return _marker(scene, where, values, scene.session.hours)


def marker_heat(scene: Scene, state: State, where: str, values: Values) -> Action:
    """One reflector's post grows with temperature."""
    return _marker(scene, where, values, scene.session.temperature - 20.0)


def marker_load(scene: Scene, state: State, where: str, values: Values) -> Action:
    """One reflector's post gives way when the tool is loaded."""
    return _marker(scene, where, values, (scene.session.force[:, 2] != 0.0).astype(float))


def third_harmonic(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Three periods a turn."""
    q = 3.0 * scene.session.q[:, index(scene, where)]
    return turned(scene, where, values["a"] * np.cos(q) + values["b"] * np.sin(q))


def damaged_teeth(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A bump of the gear about one angle, 25 degrees wide."""
    q = scene.session.q[:, index(scene, where)]
    return turned(scene, where, values["a"] * np.exp(-0.5 * ((q - values["b"]) / 0.22) ** 2))


def creep(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A drive that follows the torque of the last minutes instead of the present one."""
    k, time = index(scene, where), scene.session.time
    lagged = np.zeros(scene.count)
    for i in range(1, scene.count):
        keep = np.exp(-(time[i] - time[i - 1]) / 240.0)
        lagged[i] = keep * lagged[i - 1] + (1.0 - keep) * state.torque[i - 1, k]
    return turned(scene, where, values["a"] * lagged)


def cable_pull(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A hose bundle that pulls on a joint as that joint and its neighbour stand."""
    k = index(scene, where)
    q, other = scene.session.q[:, k], scene.session.q[:, k - 1]
    return turned(scene, where, values["a"] * np.sin(q + 0.5) * np.cos(other + values["b"]))


def wandering_axis(scene: Scene, state: State, where: str, values: Values) -> Action:
    """An axis that tilts with the angle of the joint before it."""
    k, action = index(scene, where), scene.nothing()
    across = np.cross(scene.arm.axes[k], [0.6, 0.5, 0.4])
    size = values["a"] * np.sin(2.0 * scene.session.q[:, k - 1] + values["b"])
    action.twist[:, k + 1, 3:] = np.outer(size, across)
    return action


def overshoot(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A joint that stops the farther off, the larger the move was."""
    k = index(scene, where)
    return turned(scene, where, values["a"] * scene.session.motion[:, k])


def warm_encoder(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A zero that follows the temperature."""
    return turned(scene, where, values["a"] * (scene.session.temperature - 20.0))


def hardening_drive(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A drive that is soft at small torque: lost motion that saturates."""
    torque = state.torque[:, index(scene, where)]
    knee = 0.15 * max(float(np.abs(torque).max()), 1e-9)
    return turned(scene, where, values["a"] * np.tanh(torque / knee))


def slipped_joint(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A joint whose zero jumps once in the session."""
    after = scene.session.hours > values["b"] * scene.session.hours[-1]
    return turned(scene, where, values["a"] * after)


def bent_beam(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Distances that are wrong with the square of the range."""
    action = scene.nothing()
    away = np.linalg.norm(state.aimed, axis=-1, keepdims=True)
    action.reading[:] = values["a"] * away * state.aimed
    return action


def settling_base(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A base that moves once, in the middle of the session."""
    action = scene.nothing()
    after = scene.session.hours > values["b"] * scene.session.hours[-1]
    action.twist[:, 0] = np.outer(after, [0.3, 0.2, -1.0, 0.4, -0.3, 0.2]) * values["a"]
    return action


OUTSIDE: dict[str, Effect] = {
    effect.__name__: effect
    for effect in (
        marker_drift, marker_heat, marker_load, third_harmonic, damaged_teeth, creep, cable_pull,
        wandering_axis, overshoot, warm_encoder, hardening_drive, slipped_joint, bent_beam,
        settling_base,
    )
}  # fmt: skip
_NEEDS = {"marker_heat": "temperature", "warm_encoder": "temperature"} | dict.fromkeys(
    ("marker_drift", "creep", "overshoot", "slipped_joint", "settling_base"), "time"
)


def outside_here(scene: Scene) -> list[str]:
    """Kinds whose variable the files of a scene show."""
    return [kind for kind in OUTSIDE if kind not in _NEEDS or _NEEDS[kind] in scene.columns]


def _marker(scene: Scene, where: str, values: Values, by: Array) -> Action:
    action = scene.nothing()
    marker = int(where.removeprefix("marker:m")) - 1
    action.marker[:, marker] = np.outer(by, [values["x"], values["y"], values["z"]])
    return action


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


BEYOND: dict[str, Effect] = {
    effect.__name__: effect for effect in (two_jumps, random_walk, cable_force, saturating_lag)
}
