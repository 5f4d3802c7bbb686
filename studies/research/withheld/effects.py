"""The effects of the catalogue, each as its definition reads; linear in their parameters (SI)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene, hung
from studies.research.withheld.truth import Action, G, State

Values = Mapping[str, float]
Effect = Callable[[Scene, State, str, Values], Action]
AXES = ("x", "y", "z", "rx", "ry", "rz")
REFERENCE_DEGC = 20.0


def joint_offset(scene: Scene, state: State, where: str, values: Values) -> Action:
    """q_true = q_read + offset."""
    return turned(scene, where, np.full(scene.count, values["offset"]))


def link_geometry(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A constant displacement of the joint's frame."""
    action = scene.nothing()
    action.twist[:, index(scene, where) + 1] = _six(values)
    return action


def joint_compliance(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = compliance * torque."""
    return turned(scene, where, values["compliance"] * state.torque[:, index(scene, where)])


def stiffness_vs_angle(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = compliance(q) * torque, linear between the knots, beside the constant one."""
    k = index(scene, where)
    c = np.interp(scene.session.q[:, k], scene.knots[where], list(values.values()))
    return turned(scene, where, c * state.torque[:, k])


def gravity_compensator(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A spring that pulls the anchor on the link towards the anchor on the link before it."""
    spring = scene.arm.spring
    assert spring is not None  # noqa: S101
    k, before = index(scene, where), np.asarray(spring[1])
    axis, after = scene.arm.axes[k], np.asarray(spring[2])

    def anchor(q: Array) -> Array:
        along = axis * (axis @ after)
        across = np.cross(axis, after)
        c, s = np.cos(q)[:, None], np.sin(q)[:, None]
        moved: Array = along + c * (after - along) + s * across
        return moved

    def length(q: Array) -> Array:
        return np.asarray(np.linalg.norm(anchor(q) - before, axis=1))

    q = scene.session.q[:, k]
    pull = values["preload"] + values["spring"] * (length(q) - length(np.zeros(1)))
    force = pull[:, None] * (before - anchor(q)) / length(q)[:, None]
    torque = np.cross(anchor(q), force) @ axis
    return turned(scene, where, scene.compliance[k] * torque)


def gravity_sag(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Weights of all links, of which the user knows nothing."""
    action = scene.nothing()
    action.load[:, 1:-1, 2] = -G * values["weight"] * scene.arm.masses
    return action


def link_weight(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Correction of a link's mass, its centre staying where it is."""
    action = scene.nothing()
    action.load[:, index(scene, where) + 1, 2] = -G * values["mass"]
    return action


def payload(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Correction of the carried mass, of its centre, or of the measured wrench."""
    action = scene.nothing()
    R = state.R_link[:, -1]
    shift = np.array([values.get(f"com_{c}", 0.0) for c in "xyz"])
    action.load[:, -1] = hung(R, values.get("mass", 0.0), scene.com)
    action.load[:, -1] += hung(R, scene.payload, shift) * [0, 0, 0, 1, 1, 1]
    action.load[:, -1] += values.get("scale", 0.0) * scene.wrench
    return action


def transmission_harmonic(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Once and twice a turn of the output."""
    q = scene.session.q[:, index(scene, where)]
    dq = sum(
        values.get(f"cos_{k}", 0.0) * np.cos(k * q) + values.get(f"sin_{k}", 0.0) * np.sin(k * q)
        for k in (1, 2)
    )
    return turned(scene, where, np.asarray(dq))


def transmission_scale(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = scale * q."""
    return turned(scene, where, values["scale"] * scene.session.q[:, index(scene, where)])


def joint_coupling(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = from_<joint> * q of that joint."""
    dq = np.zeros(scene.count)
    for name, value in values.items():
        dq += value * scene.session.q[:, index(scene, name.removeprefix("from_"))]
    return turned(scene, where, dq)


def backlash(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = half_width * approach."""
    return turned(
        scene, where, values["half_width"] * scene.session.approach[:, index(scene, where)]
    )


def bearing_compliance(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Rotation across the axis by the moment across it."""
    k, action = index(scene, where), scene.nothing()
    moment, axis = state.wrench[:, k + 1, 3:], scene.arm.axes[k]
    action.twist[:, k + 1, 3:] = values["tilt"] * (moment - np.outer(moment @ axis, axis))
    return action


def base_compliance(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Tilt of the base about its horizontal directions by the moment about them."""
    action = scene.nothing()
    action.twist[:, 0, 3:5] = values["tilt"] * state.wrench[:, 0, 3:5]
    return action


def base_drift(scene: Scene, state: State, where: str, values: Values) -> Action:
    """A motion of the base in proportion to time, zero at the first pose."""
    action = scene.nothing()
    action.twist[:, 0] = np.outer(scene.session.hours, _six(values))
    return action


def thermal_expansion(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Links grow along the way from their joint to the next one, from 20 degC."""
    action = scene.nothing()
    dT = scene.session.temperature - REFERENCE_DEGC
    for frame in range(1, scene.arm.dof + 2):
        own = frame > 1 and where == scene.arm.names[frame - 2]
        if own or where == "arm":
            action.twist[:, frame, :3] = values["growth"] * dT[:, None] * segment(scene, frame)
    return action


def tool_compliance(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Six springs between flange and tool."""
    action = scene.nothing()
    action.twist[:, -1] = state.wrench[:, -1] * _six(values)
    return action


def tracker_scale(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Readings grow from the instrument's origin."""
    action = scene.nothing()
    action.reading[:] = values["scale"] * state.aimed
    return action


def tracker_drift(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Readings move as one body in proportion to time, in the instrument's frame."""
    action = scene.nothing()
    moved = scene.session.hours[:, None] * _six(values)
    turn = np.cross(moved[:, None, 3:], state.aimed)
    action.reading[:] = moved[:, None, :3] + turn
    return action


CATALOGUE: dict[str, Effect] = {
    effect.__name__: effect
    for effect in (
        joint_offset,
        link_geometry,
        joint_compliance,
        stiffness_vs_angle,
        gravity_compensator,
        gravity_sag,
        link_weight,
        payload,
        transmission_harmonic,
        transmission_scale,
        joint_coupling,
        backlash,
        bearing_compliance,
        base_compliance,
        base_drift,
        thermal_expansion,
        tool_compliance,
        tracker_scale,
        tracker_drift,
    )
}


def index(scene: Scene, joint: str) -> int:
    """Position of a joint, 0 .. n - 1; its frame is the next number."""
    return scene.arm.names.index(joint)


def turned(scene: Scene, joint: str, dq: Array) -> Action:
    """An error of one joint's variable, shape (N,)."""
    action = scene.nothing()
    action.joint[:, index(scene, joint)] = dq
    return action


def segment(scene: Scene, frame: int) -> Array:
    """The way from the frame before to frame 1 .. n + 1, in the latter's axes, shape (3,), m."""
    arm = scene.arm
    last = frame > arm.dof
    xyz = arm.tip_xyz if last else arm.joints[frame - 1].xyz
    rpy = arm.tip_rpy if last else arm.joints[frame - 1].rpy
    way: Array = Rotation.from_euler("xyz", rpy).inv().apply(xyz)
    return way


def _six(values: Values) -> Array:
    return np.array([values.get(name, 0.0) for name in AXES])


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
    return turned(scene, where, np.asarray(dq))


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
    return turned(scene, where, -lag)


def friction_windup(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = -compliance * torque * approach."""
    k = scene.arm.names.index(where)
    wound = scene.compliance[k] * values["torque"] * scene.session.approach[:, k]
    return turned(scene, where, -wound)


def measured_torque(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Dq = compliance * torque, as the file shows the torque."""
    assert scene.measured is not None  # noqa: S101
    torque = scene.measured[:, scene.arm.names.index(where)]
    return turned(scene, where, values["compliance"] * torque)


EFFECTS = {
    effect.__name__: effect
    for effect in (gear_ripple, warm_up, step, settling, friction_windup, measured_torque)
}


def displaced(scene: Scene, state: State, where: str, values: Values, by: Array) -> Action:
    """A constant displacement of a place, times ``by``, shape (N,)."""
    if where in scene.arm.names:
        return turned(scene, where, values["offset"] * by)
    action = scene.nothing()
    moved = np.outer(by, [values.get(name, 0.0) for name in AXES])
    if where == "base":
        action.twist[:, 0] = moved
    elif where == "instrument":
        action.reading[:] = moved[:, None, :3] + np.cross(moved[:, None, 3:], state.aimed)
    else:
        action.marker[:, int(where.removeprefix("marker:m")) - 1] = moved[:, :3]
    return action
