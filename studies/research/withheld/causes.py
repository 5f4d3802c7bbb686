"""A cause at a place with its size, where it can sit in a scene, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from studies.research.withheld.effects import AXES, BEYOND, EFFECTS, outside_here, segment
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Action, State

Values = dict[str, float]


@dataclass(frozen=True, eq=False)
class Cause:
    """Linear in its size.

    effect, where : names; ``values`` : SI, of a cause of size one
    size : factor on what it does
    shape : joint whose angle modulates it and phase [rad] of a wrong shape, or None
    """

    effect: str
    where: str
    values: Values
    size: float = 1.0
    shape: tuple[int, float] | None = None

    @property
    def scored(self) -> bool:
        """Whether intervals of its parameters are to hold their values."""
        return self.shape is None

    def sized(self, factor: float) -> Self:
        """The same, so many times as large."""
        return replace(self, size=self.size * factor)

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        factor = np.full(scene.count, self.size)
        if self.shape is not None:
            joint, phase = self.shape
            factor *= 1.0 + 0.35 * np.sin(2.0 * scene.session.q[:, joint] + phase)
        action.add(EFFECTS[self.effect](scene, state, self.where, self.values), factor)


@dataclass(frozen=True, eq=False)
class Foreign(Cause):
    """A cause of the catalogue by another formula; its values are those of tuned parameters alone.

    act : what it does at size one; alike : further names that are right
    """

    act: Callable[[Scene, State], Action] = field(kw_only=True)
    alike: tuple[str, ...] = ()

    @property
    def scored(self) -> bool:
        """Never: the parameters of its formula are not the catalogue's."""
        return False

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        action.add(self.act(scene, state), np.full(scene.count, self.size))


def places(scene: Scene) -> dict[str, list[str]]:
    """Where each effect of the catalogue can sit in a scene and be a gap in the user's model."""
    arm, names = scene.arm, list(scene.arm.names)
    turns = [j.name for j in arm.joints if not j.slides]
    soft = [j.name for j in arm.joints if j.compliance]
    beyond = names[names.index(soft[0]) :] if soft else []
    found = {
        "joint_compliance": [name for name in soft if name not in scene.modelled],
        "stiffness_vs_angle": [name for name in scene.modelled if name in scene.knots],
        "transmission_harmonic": turns,
        "transmission_scale": names,
        "joint_coupling": turns[1:],
        "backlash": names,
        "bearing_compliance": turns,
        "base_compliance": ["base"],
        "tool_compliance": ["tool"],
        "payload": ["payload"],
    }
    if scene.known_geometry:
        found |= {"joint_offset": names, "link_geometry": names, "tracker_scale": ["instrument"]}
    if arm.spring is not None and arm.spring[0] in scene.modelled:
        found["gravity_compensator"] = [arm.spring[0]]
    if scene.weighs:
        found["link_weight"] = beyond
    elif scene.modelled:
        found["gravity_sag"] = [scene.modelled[0] if len(scene.modelled) == 1 else "arm"]
    if "time" in scene.columns:
        found |= {"base_drift": ["base"], "tracker_drift": ["instrument"]}
    if "temperature" in scene.columns:
        grows = [n for k, n in enumerate(names) if np.linalg.norm(segment(scene, k + 2)) > 0.05]
        found["thermal_expansion"] = ["arm", *grows]
    return {effect: where for effect, where in found.items() if where}


def draw_cause(rng: np.random.Generator, scene: Scene) -> Cause:
    """An effect of the catalogue at one of its places.

    Between drawing among kinds and drawing among places: kinds that have one place are seen often
    enough to be judged, and do not crowd out the rest. What few scenes allow is frequent in those.
    """
    found = places(scene)
    kinds = list(found)
    weight = np.array([len(found[kind]) for kind in kinds]) ** 0.75
    weight *= [3.0 if kind in _RARE else 1.0 for kind in kinds]
    kind = str(rng.choice(kinds, p=weight / weight.sum()))
    where = str(rng.choice(found[kind]))
    return cause_at(rng, scene, kind, where)


def draw_outside(rng: np.random.Generator, scene: Scene) -> Cause:
    """A cause that the catalogue does not hold."""
    return outside_of(rng, scene, str(rng.choice(outside_here(scene))))


def outside_of(rng: np.random.Generator, scene: Scene, kind: str) -> Cause:
    """One of a kind outside the catalogue."""
    arm = scene.arm
    if kind.startswith("marker"):
        where = f"marker:m{rng.integers(len(scene.markers)) + 1}"
        return Cause(kind, where, direction(rng, ("x", "y", "z"), 5e-5))
    size = {"bent_beam": 1e-6, "creep": 0.3 * _drive(scene), "warm_encoder": 2e-5}.get(kind, 1e-4)
    values = {"a": size * float(rng.choice([-1.0, 1.0]))}
    if kind in ("cable_pull", "wandering_axis"):
        values["b"] = float(rng.uniform(0.0, 2.0 * np.pi))
    if kind in ("slipped_joint", "settling_base"):
        values["b"] = float(rng.uniform(0.3, 0.7))
    if kind == "settling_base":
        return Cause(kind, "base", values)
    if kind == "bent_beam":
        return Cause(kind, "instrument", values)
    # The first two joints of a chain carry no torque where they stand upright.
    soft = [k for k, j in enumerate(arm.joints) if j.compliance]
    turns = [k for k, j in enumerate(arm.joints) if not j.slides and k > 0]
    k = int(rng.choice(soft if kind in ("creep", "hardening_drive") else turns))
    if kind == "damaged_teeth":
        low, high = arm.limits[k]
        values["b"] = float(rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high))
    if kind == "third_harmonic":
        values = direction(rng, ("a", "b"))
    if kind in ("creep", "hardening_drive"):
        values["a"] = abs(values["a"])
    return Cause(kind, arm.names[k], values)


def with_wrong_shape(rng: np.random.Generator, scene: Scene, cause: Cause) -> Cause:
    """The same cause, modulated by 35 % with the angle of its joint, or of any other."""
    names = scene.arm.names
    joint = names.index(cause.where) if cause.where in names else int(rng.integers(len(names)))
    return replace(cause, shape=(joint, float(rng.uniform(0.0, 2.0 * np.pi))))


_RARE = ("joint_compliance", "gravity_sag", "link_geometry", "tracker_scale", "gravity_compensator")

Unit = Callable[[np.random.Generator, Scene, str, str], Values]


def direction(rng: np.random.Generator, names: tuple[str, ...], size: float = 1e-4) -> Values:
    """A vector of random direction over named parameters."""
    d = rng.normal(size=len(names))
    return dict(zip(names, (size * d / np.linalg.norm(d)).tolist(), strict=True))


def _drive(scene: Scene) -> float:
    """A typical compliance of the arm's softer joints, rad/(N m)."""
    return max(joint.compliance for joint in scene.arm.joints)


def _one(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    name, size, positive = _SINGLE[kind]
    sign = 1.0 if positive else float(rng.choice([-1.0, 1.0]))
    elastic = name in ("compliance", "tilt")
    return {name: size * sign * (_drive(scene) if elastic else 1.0)}


# Parameter, a size that moves the markers by some hundredths of a millimetre (elastic ones in parts of
# a typical drive), and whether nature allows one sign only.
_SINGLE = {
    "joint_offset": ("offset", 1e-4, False),
    "joint_compliance": ("compliance", 0.1, True),
    "gravity_sag": ("weight", 0.1, True),
    "link_weight": ("mass", 1.0, False),
    "transmission_scale": ("scale", 1e-4, False),
    "backlash": ("half_width", 1e-4, False),
    "bearing_compliance": ("tilt", 0.02, True),
    "base_compliance": ("tilt", 0.01, True),
    "thermal_expansion": ("growth", 1e-5, True),
    "tracker_scale": ("scale", 1e-5, False),
    "friction_windup": ("torque", 10.0, True),
    "measured_torque": ("compliance", 0.1, True),
}


def _any_six(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    return direction(rng, AXES)


def _tool(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    # The angles matter most, and a spring gives way only in the direction of its load.
    reach = scene.arm.tool
    turn = np.abs(rng.normal(size=3)) * 0.1 * _drive(scene)
    slide = np.abs(rng.normal(size=3)) * 0.1 * _drive(scene) * reach**2
    return dict(zip(AXES, [*slide.tolist(), *turn.tolist()], strict=True))


def _harmonic(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    orders = [(1,), (2,), (1, 2)][int(rng.choice(3, p=[0.4, 0.25, 0.35]))]
    return direction(rng, tuple(f"{f}_{k}" for k in orders for f in ("cos", "sin")))


def _coupling(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    names = [j.name for j in scene.arm.joints if not j.slides]
    before = names[max(names.index(where) - 2, 0) : names.index(where)]
    return {f"from_{rng.choice(before)}": 1e-4 * float(rng.choice([-1.0, 1.0]))}


def _stiffness(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    change = rng.normal(size=len(scene.knots[where]))
    change -= change.mean()
    shown = np.degrees(scene.knots[where])
    change *= 0.1 * _drive(scene)
    return {f"compliance@{k:g}": float(c) for k, c in zip(shown, change, strict=True)}


def _spring(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    stiff, pull = rng.uniform(0.2, 1.0, 2) * scene.arm.load
    return {"spring": float(stiff) / 0.1, "preload": float(pull)}


def _payload(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    sign = float(rng.choice([-1.0, 1.0]))
    if not scene.payload:
        return {"scale": 0.02 * sign}
    if rng.random() < 0.5:
        return {"mass": 0.05 * scene.payload * sign}
    return direction(rng, ("com_x", "com_y", "com_z"), 0.01)


RATIO = (50, 160)
TAU = (0.05, 0.6)
"""Time constants of a warm-up in lengths of the session."""
_MOMENT = (0.12, 0.88)  # of a step, in lengths of the session
_NEW = 0.7  # share of the causes that the first families do not have
_SECOND = 0.3  # share of the ripples with a second harmonic
# What the catalogue came to hold: no causes outside it any more.
_HELD = ("third_harmonic", "slipped_joint", "settling_base")


def new_places(scene: Scene) -> dict[str, list[str]]:
    """Where each of the new effects can sit in a scene."""
    turns = [j.name for j in scene.arm.joints if not j.slides]
    markers = [f"marker:m{m + 1}" for m in range(len(scene.markers))]
    found = {
        "gear_ripple": turns,
        "warm_up": ["base", "instrument", *turns],
        "step": ["base", "instrument", *turns, *(markers if len(markers) > 1 else [])],
        "settling": turns,
        "friction_windup": list(scene.modelled),
    }
    if scene.measured is not None:
        found["measured_torque"] = [j.name for j in scene.arm.joints if j.compliance]
    return {kind: where for kind, where in found.items() if where}


def draw_real(rng: np.random.Generator, scene: Scene) -> Cause:
    """An effect of the catalogue, more often one of the new ones."""
    if rng.random() > _NEW:
        return draw_cause(rng, scene)
    found = new_places(scene)
    kind = str(rng.choice(list(found)))
    return cause_at(rng, scene, kind, str(rng.choice(found[kind])))


def cause_at(rng: np.random.Generator, scene: Scene, kind: str, where: str) -> Cause:
    """One of a kind at a place."""
    return Cause(kind, where, _UNIT.get(kind, _one)(rng, scene, where, kind))


def draw_beyond(rng: np.random.Generator, scene: Scene) -> Cause:
    """A cause that the catalogue does not hold, one of the further ones every other time."""
    if rng.random() < 0.5:
        usual = [
            kind for kind in outside_here(scene) if kind not in _HELD and _possible(scene, kind)
        ]
        return outside_of(rng, scene, str(rng.choice(usual)))
    kinds = [kind for kind in BEYOND if kind != "cable_force" or scene.modelled]
    kind = str(rng.choice(kinds))
    turns = [j.name for k, j in enumerate(scene.arm.joints) if not j.slides and k > 0]
    joint = str(rng.choice(turns))
    if kind == "two_jumps":
        both = {"offset": float(rng.choice([-1e-4, 1e-4])), "at": _moment(rng, scene)}
        return Cause(kind, joint, {**both, **direction(rng, AXES)})
    if kind == "random_walk":
        return Cause(kind, "base", {"a": 1e-5, "seed": float(rng.integers(1 << 30))})
    if kind == "cable_force":
        reach = float(np.sum(np.linalg.norm([j.xyz for j in scene.arm.joints], axis=1)))
        anchor = rng.uniform((-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)) * reach
        return Cause(kind, "tip", {"a": 10.0, **dict(zip("xyz", anchor.tolist(), strict=True))})
    return Cause(kind, joint, {"a": 1e-4, "b": float(rng.uniform(0.15, 0.5))})


def all_places(scene: Scene) -> dict[str, list[str]]:
    """Places of old and new effects together."""
    return {**places(scene), **new_places(scene)}


def _possible(scene: Scene, kind: str) -> bool:
    """What sits in a drive needs one that yields; what moves one reflector needs another beside it."""
    if kind in ("creep", "hardening_drive"):
        return any(joint.compliance for joint in scene.arm.joints)
    return not kind.startswith("marker") or len(scene.markers) > 1


def _ripple(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    found = {"cycles": 2.0 * scene.ratios[where], **direction(rng, ("cos_1", "sin_1"))}
    if rng.random() < _SECOND:
        found |= direction(rng, ("cos_2", "sin_2"), float(rng.uniform(3e-5, 6e-5)))
    return found


def _warm_up(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    low, high = np.log(TAU)
    tau = float(np.exp(rng.uniform(low, high))) * float(fitted_clock(scene)[-1])
    return {**_displacement(rng, scene, where), "tau": tau}


def _step(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    return {**_displacement(rng, scene, where), "at": _moment(rng, scene)}


def _moment(rng: np.random.Generator, scene: Scene) -> float:
    """Between two readings, well within those that are fitted."""
    clock = fitted_clock(scene)
    k = int(rng.uniform(*_MOMENT) * len(clock))
    return float(clock[k - 1] + clock[k]) / 2.0


def fitted_clock(scene: Scene) -> Array:
    """The clock of the readings that are fitted, in order, s or readings."""
    return scene.clock[~scene.session.held]


def _displacement(rng: np.random.Generator, scene: Scene, where: str) -> Values:
    if where in scene.arm.names:
        return {"offset": float(rng.choice([-1e-4, 1e-4]))}
    return direction(rng, AXES if where in ("base", "instrument") else AXES[:3])


def _settling(rng: np.random.Generator, scene: Scene, where: str, kind: str) -> Values:
    if scene.arm.slides.any() or rng.random() < 0.5:  # metres and radians share no longest move
        return {"per_move": 1e-4}
    return {"per_speed": 2e-4}


_UNIT: dict[str, Unit] = {
    "link_geometry": _any_six,
    "stiffness_vs_angle": _stiffness,
    "gravity_compensator": _spring,
    "payload": _payload,
    "transmission_harmonic": _harmonic,
    "joint_coupling": _coupling,
    "base_drift": _any_six,
    "tool_compliance": _tool,
    "tracker_drift": _any_six,
    "gear_ripple": _ripple,
    "warm_up": _warm_up,
    "step": _step,
    "settling": _settling,
}
"""Values of size one by kind; of all others one parameter of ``_SINGLE``."""
