"""What real arms do beside: fine gear errors, the last move, the clock, torques that they measure."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studies.research.withheld.actions import Action, State
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene

Values = Mapping[str, float]
AXES = ("x", "y", "z", "rx", "ry", "rz")
TUNED = ("cycles", "tau", "at")
"""Parameters that do not scale with the size of a cause."""


def gear_ripple(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = sum of cos_k cos(k c q) + sin_k sin(k c q), c cycles a turn of the joint."""
    turns = values["cycles"] * scene.session.q[:, scene.arm.names.index(where)]
    dq = sum(
        values.get(f"cos_{k}", 0.0) * np.cos(k * turns)
        + values.get(f"sin_{k}", 0.0) * np.sin(k * turns)
        for k in (1, 2)
    )
    return _turned(scene, where, np.asarray(dq))


def warm_up(scene: Scene, state: State, where: str, values: Values) -> Action:
    """What is left of a displacement, exp(-t / tau)."""
    return displaced(scene, state, where, values, np.exp(-scene.clock / values["tau"]))


def step(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Base, instrument, joint or marker jumps at one moment and stays."""
    return displaced(scene, state, where, values, (scene.clock >= values["at"]).astype(float))


def settling(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = -(per_move * move + per_speed * move / longest), read before the joint is at rest."""
    moves = scene.session.moves
    own = moves[:, scene.arm.names.index(where)]
    longest = np.abs(moves).max(axis=1)
    share = own / np.where(longest > 0.0, longest, 1.0)
    lag = values.get("per_move", 0.0) * own + values.get("per_speed", 0.0) * share
    return _turned(scene, where, -lag)


def friction_windup(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = -compliance * torque * approach."""
    k = scene.arm.names.index(where)
    wound = scene.compliance[k] * values["torque"] * scene.session.approach[:, k]
    return _turned(scene, where, -wound)


def measured_torque(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = compliance * torque, as the file shows the torque."""
    assert scene.measured is not None  # noqa: S101
    torque = scene.measured[:, scene.arm.names.index(where)]
    return _turned(scene, where, values["compliance"] * torque)


EFFECTS = {
    effect.__name__: effect
    for effect in (gear_ripple, warm_up, step, settling, friction_windup, measured_torque)
}


def displaced(scene: Scene, state: State, where: str, values: Values, by: Array) -> Action:
    """A constant displacement of a place, times ``by``, shape (N,)."""
    if where in scene.arm.names:
        return _turned(scene, where, values["offset"] * by)
    action = scene.nothing()
    moved = np.outer(by, [values.get(name, 0.0) for name in AXES])
    if where == "base":
        action.twist[:, 0] = moved
    elif where == "instrument":
        action.reading[:] = moved[:, None, :3] + np.cross(moved[:, None, 3:], state.aimed)
    else:
        action.marker[:, int(where.removeprefix("marker:m")) - 1] = moved[:, :3]
    return action


def _turned(scene: Scene, joint: str, dq: Array) -> Action:
    action = scene.nothing()
    action.joint[:, scene.arm.names.index(joint)] = dq
    return action
