"""The table of all effects: formula, places, sizes, and what each needs.

A row of ``EFFECTS`` is a cause that the catalogue of the program holds; ``OUTSIDE`` are those that no
catalogue holds, ``BEYOND`` such of real arms besides. ``formula_of`` looks in all three.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from studies.research.truth import formulas as f
from studies.research.truth.arms import Array
from studies.research.truth.formulas import (
    AXES,
    Effect,
    of_frame,
    of_joint,
    of_load,
    of_marker,
    of_place,
    of_reading,
    six,
    wave,
    weights,
)
from studies.research.truth.mechanism import Action, State
from studies.research.truth.scene import Scene

Sizes = dict[str, float]
Unit = Callable[[np.random.Generator, Scene, str], Sizes]
Places = Callable[[Scene], Sequence[str]]
TUNED = ("cycles", "tau", "at")
"""Parameters that do not scale with the size of a cause."""
_TAU = (0.05, 0.6)  # time constants of a warm-up in lengths of the session
_MOMENT = (0.12, 0.88)  # of a step, in lengths of the session
_SECOND = 0.3  # share of the ripples with a second harmonic
HARMONICS = ("cos_1", "sin_1", "cos_2", "sin_2")


@dataclass(frozen=True)
class Kind:
    """A row of the table.

    act : what it does in a state; places : where it can sit in a scene and be a gap in the user's model
    unit : SI values of a cause of size one, which moves the markers by some hundredths of a millimetre
    rare : few scenes allow it, so it is drawn more often there
    most : largest value of each parameter, some ten times what arms show. An arm that scatters hides
        smaller ones: without a bound a cause that is to be seen beside it grows beyond belief
    believed : largest length of all angles together on a day of a real arm
    """

    act: Effect
    places: Places
    unit: Unit
    rare: bool = False
    most: Mapping[str, float] = field(default_factory=dict)
    believed: float = np.inf


def direction(rng: np.random.Generator, names: Sequence[str], size: float = 1e-4) -> Sizes:
    """A vector of random direction over named parameters."""
    d = rng.normal(size=len(names))
    return dict(zip(names, (size * d / np.linalg.norm(d)).tolist(), strict=True))


def sign(rng: np.random.Generator) -> float:
    """Up or down."""
    return float(rng.choice([-1.0, 1.0]))


def drive(scene: Scene) -> float:
    """A typical compliance of the arm's softer joints, rad/(N m)."""
    return max(joint.compliance for joint in scene.arm.joints)


def _one(name: str, size: float, positive: bool = False) -> Unit:
    """One parameter; positive : nature allows one sign only."""
    return lambda rng, scene, where: {name: size * (1.0 if positive else sign(rng))}


def _elastic(name: str, share: float) -> Unit:
    """In parts of a typical drive."""
    return lambda rng, scene, where: {name: share * drive(scene)}


def _six(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    return direction(rng, AXES)


def _tool(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    # The angles matter most, and a spring gives way only in the direction of its load.
    turn = np.abs(rng.normal(size=3)) * 0.1 * drive(scene)
    slide = np.abs(rng.normal(size=3)) * 0.1 * drive(scene) * scene.arm.tool**2
    return dict(zip(AXES, [*slide.tolist(), *turn.tolist()], strict=True))


def _harmonic(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    orders = (HARMONICS[:2], HARMONICS[2:], HARMONICS)
    return direction(rng, orders[int(rng.choice(3, p=[0.4, 0.25, 0.35]))])


def _coupling(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    k = scene.arm.turning.index(where)
    return {f"from_{rng.choice(scene.arm.turning[max(k - 2, 0) : k])}": 1e-4 * sign(rng)}


def _stiffness(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    change = rng.normal(size=len(scene.knots[where]))
    change = (change - change.mean()) * (0.1 * drive(scene))
    shown = np.degrees(scene.knots[where])
    return {f"compliance@{k:g}": float(c) for k, c in zip(shown, change, strict=True)}


def _spring(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    stiff, pull = rng.uniform(0.2, 1.0, 2) * scene.arm.load
    return {"spring": float(stiff) / 0.1, "preload": float(pull)}


def _payload(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    side = sign(rng)
    if not scene.payload:
        return {"scale": 0.02 * side}
    if rng.random() < 0.5:
        return {"mass": 0.05 * scene.payload * side}
    return direction(rng, ("com_x", "com_y", "com_z"), 0.01)


def _ripple(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    first = {"cycles": 2.0 * scene.ratios[where], **direction(rng, HARMONICS[:2])}
    if rng.random() < _SECOND:
        first |= direction(rng, HARMONICS[2:], float(rng.uniform(3e-5, 6e-5)))
    return first


def _warm_up(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    tau = float(np.exp(rng.uniform(*np.log(_TAU)))) * float(scene.fitted_clock[-1])
    return {**_displacement(rng, scene, where), "tau": tau}


def _step(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    return {**_displacement(rng, scene, where), "at": moment(rng, scene)}


def _displacement(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    if where in scene.arm.names:
        return {"offset": 1e-4 * sign(rng)}
    return direction(rng, AXES if where in ("base", "instrument") else AXES[:3])


def moment(rng: np.random.Generator, scene: Scene) -> float:
    """Between two readings, well within those that are fitted."""
    clock = scene.fitted_clock
    k = int(rng.uniform(*_MOMENT) * len(clock))
    return float(clock[k - 1] + clock[k]) / 2.0


def _settling(rng: np.random.Generator, scene: Scene, where: str) -> Sizes:
    if scene.arm.slides.any() or rng.random() < 0.5:  # metres and radians share no longest move
        return {"per_move": 1e-4}
    return {"per_speed": 2e-4}


def _joints(scene: Scene) -> Sequence[str]:
    return scene.arm.names


def _turning(scene: Scene) -> Sequence[str]:
    return scene.arm.turning


def _all_known(where: Places) -> Places:
    """Where the user's model has no geometry."""
    return lambda scene: where(scene) if scene.conditions.known_geometry else ()


def _shown(column: str, *where: str) -> Places:
    """Where the files show a column."""
    return lambda scene: where if column in scene.conditions.columns else ()


def _weighed(scene: Scene) -> Sequence[str]:
    """The links from the first joint that yields."""
    names, soft = scene.arm.names, scene.arm.soft
    return names[names.index(soft[0]) :] if soft and scene.conditions.weighs else ()


def _sagging(scene: Scene) -> Sequence[str]:
    if scene.conditions.weighs or not scene.modelled:
        return ()
    return [scene.modelled[0] if len(scene.modelled) == 1 else "arm"]


def _growing(scene: Scene) -> Sequence[str]:
    lengths = [np.linalg.norm(f.segment(scene.arm, k + 2)) for k in range(scene.arm.dof)]
    long = [name for name, way in zip(scene.arm.names, lengths, strict=True) if way > 0.05]
    return ["arm", *long] if "temperature" in scene.conditions.columns else ()


def _sprung(scene: Scene) -> Sequence[str]:
    spring = scene.arm.spring
    return [spring[0]] if spring is not None and spring[0] in scene.modelled else ()


def _stepping(scene: Scene) -> Sequence[str]:
    markers = [f"marker:m{m + 1}" for m in range(len(scene.markers))]
    return ["base", "instrument", *scene.arm.turning, *(markers if len(markers) > 1 else ())]


def _q(scene: Scene, k: int) -> Array:
    return scene.session.q[:, k]


_JUMP = of_place(lambda s, v: (s.clock >= v["at"]).astype(float))
_SETTLED = np.array([0.3, 0.2, -1.0, 0.4, -0.3, 0.2])


def _two_jumps(scene: Scene, state: State, where: str, values: f.Values) -> Action:
    # A collision: the joint's zero and the base jump at the same moment.
    action = _JUMP(scene, state, where, values)
    action.add(_JUMP(scene, state, "base", values), np.ones(scene.count))
    return action


FIRST: dict[str, Kind] = {
    "joint_compliance": Kind(
        of_joint(lambda s, at, k, v: v["compliance"] * at.torque[:, k]),
        lambda s: [name for name in s.arm.soft if name not in s.modelled],
        _elastic("compliance", 0.1), rare=True, most={"compliance": 3e-4},
    ),
    "stiffness_vs_angle": Kind(
        of_joint(f.stiffness_vs_angle),
        lambda s: [name for name in s.modelled if name in s.knots], _stiffness,
    ),
    "transmission_harmonic": Kind(
        of_joint(lambda s, _, k, v: wave(_q(s, k), v)), _turning, _harmonic,
        most=dict.fromkeys(HARMONICS, 2e-3), believed=2e-3,
    ),
    "transmission_scale": Kind(
        of_joint(lambda s, _, k, v: v["scale"] * _q(s, k)), _joints, _one("scale", 1e-4)
    ),
    "joint_coupling": Kind(
        of_joint(f.joint_coupling), lambda s: s.arm.turning[1:], _coupling
    ),
    "backlash": Kind(
        of_joint(lambda s, _, k, v: v["half_width"] * s.session.approach[:, k]), _joints,
        _one("half_width", 1e-4), most={"half_width": 2e-3}, believed=1e-3,
    ),
    "bearing_compliance": Kind(f.bearing_compliance, _turning, _elastic("tilt", 0.02)),
    # Tilt about the horizontal directions by the moment about them.
    "base_compliance": Kind(
        of_frame(lambda s, at, v: v["tilt"] * at.wrench[:, 0] * [0, 0, 0, 1, 1, 0], 0),
        lambda s: ["base"], _elastic("tilt", 0.01),
    ),
    # Six springs between flange and tool.
    "tool_compliance": Kind(
        of_frame(lambda s, at, v: at.wrench[:, -1] * six(v), -1), lambda s: ["tool"], _tool,
        most={**dict.fromkeys(AXES[:3], 1e-6), **dict.fromkeys(AXES[3:], 1e-4)},
    ),
    "payload": Kind(f.payload, lambda s: ["payload"], _payload),
    "joint_offset": Kind(
        of_joint(lambda s, _, k, v: np.full(s.count, v["offset"])), _all_known(_joints),
        _one("offset", 1e-4),
    ),
    "link_geometry": Kind(
        of_frame(lambda s, at, v: six(v)), _all_known(_joints), _six, rare=True
    ),
    # Readings grow from the instrument's origin.
    "tracker_scale": Kind(
        of_reading(lambda at, v: v["scale"] * at.aimed), _all_known(lambda s: ["instrument"]),
        _one("scale", 1e-5), rare=True,
    ),
    "gravity_compensator": Kind(of_joint(f.gravity_compensator), _sprung, _spring, rare=True),
    # A link's mass is corrected, its centre stays where it is.
    "link_weight": Kind(
        of_load(lambda s, _, where, v: (s.index(where) + 1, weights(np.array([v["mass"]])))),
        _weighed, _one("mass", 1.0),
    ),
    # Weights of all links, of which the user knows nothing.
    "gravity_sag": Kind(
        of_load(lambda s, _, where, v: (slice(1, -1), weights(v["weight"] * s.arm.masses))),
        _sagging, _one("weight", 0.1, positive=True), rare=True,
    ),
    "base_drift": Kind(
        of_frame(lambda s, at, v: np.outer(s.session.hours, six(v)), 0), _shown("time", "base"), _six
    ),
    "tracker_drift": Kind(
        lambda s, at, _, v: f.moved_readings(s, at, np.outer(s.session.hours, six(v))),
        _shown("time", "instrument"), _six,
    ),
    # Links grow along the way from their joint to the next one, from 20 degC.
    "thermal_expansion": Kind(
        lambda s, at, where, v: f.grown(s, v["growth"] * f.warmth(s), where), _growing,
        _one("growth", 1e-5, positive=True), most={"growth": 4e-4}, believed=60e-6,
    ),
}  # fmt: skip
LATER: dict[str, Kind] = {
    "gear_ripple": Kind(
        of_joint(lambda s, _, k, v: wave(v["cycles"] * _q(s, k), v)), _turning, _ripple,
        believed=300e-6,
    ),
    "warm_up": Kind(
        of_place(lambda s, v: np.exp(-s.clock / v["tau"])),
        lambda s: ["base", "instrument", *s.arm.turning], _warm_up, believed=1e-3,
    ),
    "step": Kind(_JUMP, _stepping, _step, believed=3e-3),
    "settling": Kind(of_joint(f.settling), _turning, _settling, believed=2e-3),
    "friction_windup": Kind(
        of_joint(lambda s, _, k, v: -(s.compliance[k] * v["torque"] * s.session.approach[:, k])),
        lambda s: s.modelled, _one("torque", 10.0, positive=True),
    ),
    "measured_torque": Kind(
        of_joint(lambda s, _, k, v: v["compliance"] * np.asarray(s.measured)[:, k]),
        lambda s: s.arm.soft if s.measured is not None else (), _elastic("compliance", 0.1),
    ),
}  # fmt: skip
EFFECTS = {**FIRST, **LATER}


@dataclass(frozen=True)
class Outside:
    """An effect of no catalogue.

    at : "marker", "base", "instrument", or any joint that is "soft" or "turns"
    b : between which its second parameter lies; needs : a column that shows its variable
    size : of ``a``, SI, of creep in parts of a typical drive
    """

    act: Effect
    at: str = "turns"
    b: tuple[float, float] | None = None
    needs: str = ""
    size: float = 1e-4


_TURN = (0.0, 2.0 * np.pi)


OUTSIDE: dict[str, Outside] = {
    "marker_drift": Outside(of_marker(lambda s: s.session.hours), "marker", needs="time"),
    "marker_heat": Outside(of_marker(f.warmth), "marker", needs="temperature"),
    "marker_load": Outside(
        of_marker(lambda s: (s.session.force[:, 2] != 0.0).astype(float)), "marker"
    ),
    "third_harmonic": Outside(of_joint(
        lambda s, _, k, v: v["a"] * np.cos(3.0 * _q(s, k)) + v["b"] * np.sin(3.0 * _q(s, k))
    )),
    # A bump of the gear about one angle, 25 degrees wide.
    "damaged_teeth": Outside(of_joint(
        lambda s, _, k, v: v["a"] * np.exp(-0.5 * ((_q(s, k) - v["b"]) / 0.22) ** 2)
    )),
    "creep": Outside(of_joint(f.creep), at="soft", needs="time", size=0.3),
    "cable_pull": Outside(of_joint(f.cable_pull), b=_TURN),
    "wandering_axis": Outside(f.wandering_axis, b=_TURN),
    # A joint that stops the farther off, the larger the move was.
    "overshoot": Outside(
        of_joint(lambda s, _, k, v: v["a"] * s.session.motion[:, k]), needs="time"
    ),
    "warm_encoder": Outside(
        of_joint(lambda s, _, k, v: v["a"] * f.warmth(s)), needs="temperature", size=2e-5
    ),
    "hardening_drive": Outside(of_joint(f.hardening_drive), at="soft"),
    "slipped_joint": Outside(
        of_joint(lambda s, _, k, v: v["a"] * f.after(s, v["b"])), b=(0.3, 0.7), needs="time"
    ),
    # Distances that are wrong with the square of the range.
    "bent_beam": Outside(
        of_reading(
            lambda at, v: v["a"] * np.linalg.norm(at.aimed, axis=-1, keepdims=True) * at.aimed
        ),
        "instrument", size=1e-6,
    ),
    # A base that moves once, in the middle of the session.
    "settling_base": Outside(
        of_frame(lambda s, at, v: np.outer(v["a"] * f.after(s, v["b"]), _SETTLED), 0),
        "base", b=(0.3, 0.7), needs="time",
    ),
}  # fmt: skip
BEYOND: dict[str, Effect] = {
    "two_jumps": _two_jumps,
    "random_walk": of_frame(f.random_walk, 0),
    # A spring between the tip and a point fixed in the base frame, slack nowhere; ``a`` in N/m.
    "cable_force": of_load(lambda s, at, _, v: (-1, v["a"] * (six(v)[:3] - at.o[:, -1]))),
    # A lag by the last move up to ``b`` [rad or m], and by no more after longer ones.
    "saturating_lag": of_joint(
        lambda s, _, k, v: -v["a"] * np.tanh(s.session.moves[:, k] / v["b"])
    ),
}


def formula_of(name: str) -> Effect:
    """What an effect of any of the tables does."""
    if name in BEYOND:
        return BEYOND[name]
    return OUTSIDE[name].act if name in OUTSIDE else EFFECTS[name].act


def is_outside(name: str) -> bool:
    """Whether no catalogue holds it."""
    return name in OUTSIDE or name in BEYOND


def places(scene: Scene, table: Mapping[str, Kind] = EFFECTS) -> dict[str, list[str]]:
    """Where each effect of a table can sit in a scene and be a gap in the user's model."""
    found = {name: list(kind.places(scene)) for name, kind in table.items()}
    return {name: where for name, where in found.items() if where}
