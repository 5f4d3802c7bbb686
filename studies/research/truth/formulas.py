"""What moves the arm: each effect as its definition reads, linear in its parameters (SI).

An error of one joint's variable is a formula ``(scene, state, k, values) -> (N,)``, rad or m; whatever
else there is returns an action.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from studies.research.truth.arms import Arm, Array
from studies.research.truth.mechanism import Action, G, State
from studies.research.truth.scene import Scene, hung

Values = Mapping[str, float]
Effect = Callable[[Scene, State, str, Values], Action]
OfJoint = Callable[[Scene, State, int, Values], Array]
AXES = ("x", "y", "z", "rx", "ry", "rz")
_REFERENCE_DEGC = 20.0


def turned(scene: Scene, joint: str, dq: Array) -> Action:
    """An error of one joint's variable, shape (N,)."""
    return scene.only("joint", np.s_[:, scene.index(joint)], dq)


def of_joint(error: OfJoint) -> Effect:
    """An error of the joint at which an effect sits."""
    return lambda scene, state, where, values: turned(
        scene, where, error(scene, state, scene.index(where), values)
    )


def moved_frame(scene: Scene, frame: int, twist: Array) -> Action:
    """A displacement of one frame, shape (6,) or (N, 6), m and rad."""
    return scene.only("twist", np.s_[:, frame], twist)


def of_frame(twist: Callable[[Scene, State, Values], Array], frame: int | None = None) -> Effect:
    """A displacement (6,) or (N, 6) of a frame, by default of the joint at which an effect sits."""
    return lambda scene, state, where, values: moved_frame(
        scene, scene.index(where) + 1 if frame is None else frame, twist(scene, state, values)
    )


def of_load(load: Callable[[Scene, State, str, Values], tuple[int | slice, Array]]) -> Effect:
    """Forces (N, 3), base axes, at the centres of some bodies."""

    def act(scene: Scene, state: State, where: str, values: Values) -> Action:
        bodies, force = load(scene, state, where, values)
        return scene.only("load", np.s_[:, bodies, :3], force)

    return act


def of_reading(shift: Callable[[State, Values], Array]) -> Effect:
    """A shift (N, M, 3) of readings."""
    return lambda scene, state, where, values: scene.only("reading", ..., shift(state, values))


def of_place(by: Callable[[Scene, Values], Array]) -> Effect:
    """A displacement of a joint, base, instrument or marker, times (N,)."""
    return lambda scene, state, where, values: displaced(
        scene, state, where, values, by(scene, values)
    )


def weights(masses: Array) -> Array:
    """Forces of masses (n,) along -z, shape (n, 3)."""
    return np.outer(-G * masses, [0.0, 0.0, 1.0])


def moved_marker(scene: Scene, where: str, shift: Array) -> Action:
    """A displacement (N, 3) of one reflector in the tip frame, m."""
    return scene.only("marker", np.s_[:, int(where.removeprefix("marker:m")) - 1], shift)


def of_marker(motion: Callable[[Scene], Array]) -> Effect:
    """A reflector that goes off along its values."""
    return lambda scene, state, where, values: moved_marker(
        scene, where, np.outer(motion(scene), [values[c] for c in "xyz"])
    )


def moved_readings(scene: Scene, state: State, twist: Array) -> Action:
    """Readings that move as one body, twist (N, 6) in the instrument's frame."""
    turned = np.cross(twist[:, None, 3:], state.aimed)
    return scene.only("reading", ..., twist[:, None, :3] + turned)


def displaced(scene: Scene, state: State, where: str, values: Values, by: Array) -> Action:
    """A constant displacement of a place, times ``by``, shape (N,)."""
    if where in scene.arm.names:
        return turned(scene, where, values["offset"] * by)
    moved = np.outer(by, six(values))
    if where == "base":
        return moved_frame(scene, 0, moved)
    if where == "instrument":
        return moved_readings(scene, state, moved)
    return moved_marker(scene, where, moved[:, :3])


def segment(arm: Arm, frame: int) -> Array:
    """The way from the frame before to frame 1 .. n + 1, in the latter's axes, shape (3,), m."""
    last = frame > arm.dof
    xyz = arm.tip_xyz if last else arm.joints[frame - 1].xyz
    rpy = arm.tip_rpy if last else arm.joints[frame - 1].rpy
    return np.asarray(Rotation.from_euler("xyz", rpy).inv().apply(xyz))


def six(values: Values) -> Array:
    """Three shifts and three turns, zero where nothing is given."""
    return np.array([values.get(name, 0.0) for name in AXES])


def wave(q: Array, values: Values) -> Array:
    """Sum of ``cos_k cos(k q) + sin_k sin(k q)``, k = 1, 2."""
    amplitude = [(k, values.get(f"cos_{k}", 0.0), values.get(f"sin_{k}", 0.0)) for k in (1, 2)]
    return np.asarray(sum(a * np.cos(k * q) + b * np.sin(k * q) for k, a, b in amplitude))


def warmth(scene: Scene) -> Array:
    """Degrees above 20, shape (N,)."""
    return np.asarray(scene.session.temperature - _REFERENCE_DEGC)


def after(scene: Scene, share: float) -> Array:
    """Whether a share of the session's time is over."""
    hours = scene.session.hours
    return np.asarray(hours > share * hours[-1])


# -- errors of a joint -----------------------------------------------------------------------------


def gravity_compensator(scene: Scene, state: State, k: int, values: Values) -> Array:
    """A spring that pulls the anchor on the link towards the anchor on the link before it."""
    spring = scene.arm.spring
    assert spring is not None  # noqa: S101
    axis, before, anchor = scene.arm.axes[k], np.asarray(spring[1]), np.asarray(spring[2])
    q = scene.session.q[:, k]
    still = axis * (axis @ anchor)
    c, s = np.cos(q)[:, None], np.sin(q)[:, None]
    at = still + c * (anchor - still) + s * np.cross(axis, anchor)
    length = np.linalg.norm(at - before, axis=1)
    pull = values["preload"] + values["spring"] * (length - np.linalg.norm(anchor - before))
    force = pull[:, None] * (before - at) / length[:, None]
    return np.asarray(scene.compliance[k] * (np.cross(at, force) @ axis))


def joint_coupling(scene: Scene, state: State, k: int, values: Values) -> Array:
    """The values of other joints, each times ``from_<joint>``."""
    parts = (v * scene.joint(name.removeprefix("from_")) for name, v in values.items())
    return np.asarray(sum(parts, np.zeros(scene.count)))


def settling(scene: Scene, state: State, k: int, values: Values) -> Array:
    """A share of the last move that is still to come, and of its share of the longest one."""
    moves = scene.session.moves
    lag = values.get("per_move", 0.0) * moves[:, k]
    return np.asarray(-lag - values.get("per_speed", 0.0) * share_of_longest(moves, k))


def share_of_longest(moves: Array, k: int) -> Array:
    """A joint's move over the longest of the same time, shape (N,)."""
    longest = np.abs(moves).max(axis=1)
    return np.asarray(moves[:, k] / np.where(longest > 0.0, longest, 1.0))


def stiffness_vs_angle(scene: Scene, state: State, k: int, values: Values) -> Array:
    """A compliance that is linear between the knots, beside the constant one."""
    knots = scene.knots[scene.arm.names[k]]
    return np.interp(scene.session.q[:, k], knots, list(values.values())) * state.torque[:, k]


def creep(scene: Scene, state: State, k: int, values: Values) -> Array:
    """A drive that follows the torque of the last minutes instead of the present one."""
    before = np.append(0.0, state.torque[:-1, k])
    return np.asarray(values["a"] * lagging(before, scene.session.time, 240.0))


def lagging(values: Array, time: Array, lag: float) -> Array:
    """What follows values with a time constant [s], in balance at first; shape (N,)."""
    follows = values.copy()
    for i in range(1, len(time)):
        keep = np.exp(-(time[i] - time[i - 1]) / lag)
        follows[i] = keep * follows[i - 1] + (1.0 - keep) * values[i]
    return follows


def cable_pull(scene: Scene, state: State, k: int, values: Values) -> Array:
    """A hose bundle that pulls on a joint as that joint and its neighbour stand."""
    q, other = scene.session.q[:, k], scene.session.q[:, k - 1]
    return np.asarray(values["a"] * np.sin(q + 0.5) * np.cos(other + values["b"]))


def hardening_drive(scene: Scene, state: State, k: int, values: Values) -> Array:
    """A drive that is soft at small torque: lost motion that saturates."""
    torque = state.torque[:, k]
    knee = 0.15 * max(float(np.abs(torque).max()), 1e-9)
    return np.asarray(values["a"] * np.tanh(torque / knee))


# -- everything else -------------------------------------------------------------------------------


def payload(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Correction of the carried mass, of its centre, or of the measured wrench."""
    action = scene.nothing()
    R = state.R_link[:, -1]
    shift = np.array([values.get(f"com_{c}", 0.0) for c in "xyz"])
    action.load[:, -1] = hung(R, values.get("mass", 0.0), scene.com)
    action.load[:, -1] += hung(R, scene.payload, shift) * [0, 0, 0, 1, 1, 1]
    action.load[:, -1] += values.get("scale", 0.0) * scene.wrench
    return action


def bearing_compliance(scene: Scene, state: State, where: str, values: Values) -> Action:
    """Rotation across the axis by the moment across it."""
    k = scene.index(where)
    moment, axis = state.wrench[:, k + 1, 3:], scene.arm.axes[k]
    across = moment - np.outer(moment @ axis, axis)
    return scene.only("twist", np.s_[:, k + 1, 3:], values["tilt"] * across)


def grown(scene: Scene, share: Array, where: str = "arm") -> Action:
    """One link, or all, longer by a share, shape (N,)."""
    action = scene.nothing()
    for frame in range(1, scene.arm.dof + 2):
        if where == "arm" or (frame > 1 and where == scene.arm.names[frame - 2]):
            action.twist[:, frame, :3] = np.outer(share, segment(scene.arm, frame))
    return action


def wandering_axis(scene: Scene, state: State, where: str, values: Values) -> Action:
    """An axis that tilts with the angle of the joint before it."""
    k = scene.index(where)
    across = np.cross(scene.arm.axes[k], [0.6, 0.5, 0.4])
    size = values["a"] * np.sin(2.0 * scene.session.q[:, k - 1] + values["b"])
    return scene.only("twist", np.s_[:, k + 1, 3:], np.outer(size, across))


def random_walk(scene: Scene, state: State, values: Values) -> Array:
    """Independent steps of the base from reading to reading, (N, 6); ``seed`` says which way."""
    rng = np.random.default_rng(int(values["seed"]))
    steps = rng.normal(size=(scene.count, 6)) * [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    return np.asarray(np.cumsum(steps, axis=0) * values["a"])
