"""Where the causes of real arms can sit, and how they are drawn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from studies.research.withheld.causes import (
    Cause,
    Values,
    direction,
    draw_cause,
    outside_of,
    places,
)
from studies.research.withheld.outside import OUTSIDE
from studies.research.withheld.real.beyond import BEYOND
from studies.research.withheld.real.effects import AXES
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene

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
    """One of a new kind at a place."""
    return Cause(kind, where, _DRAWN[kind](rng, scene, where))


def draw_beyond(rng: np.random.Generator, scene: Scene) -> Cause:
    """A cause that the catalogue does not hold, one of the further ones every other time."""
    if rng.random() < 0.5:
        allowed = [k for k, o in OUTSIDE.items() if not o.needs or o.needs in scene.columns]
        usual = [kind for kind in allowed if kind not in _HELD and _possible(scene, kind)]
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


def _ripple(rng: np.random.Generator, scene: Scene, where: str) -> Values:
    found = {"cycles": 2.0 * scene.ratios[where], **direction(rng, ("cos_1", "sin_1"))}
    if rng.random() < _SECOND:
        found |= direction(rng, ("cos_2", "sin_2"), float(rng.uniform(3e-5, 6e-5)))
    return found


def _warm_up(rng: np.random.Generator, scene: Scene, where: str) -> Values:
    low, high = np.log(TAU)
    tau = float(np.exp(rng.uniform(low, high))) * float(fitted_clock(scene)[-1])
    return {**_displacement(rng, scene, where), "tau": tau}


def _step(rng: np.random.Generator, scene: Scene, where: str) -> Values:
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


def _settling(rng: np.random.Generator, scene: Scene, where: str) -> Values:
    if scene.arm.slides.any() or rng.random() < 0.5:  # metres and radians share no longest move
        return {"per_move": 1e-4}
    return {"per_speed": 2e-4}


def _friction(rng: np.random.Generator, scene: Scene, where: str) -> Values:
    return {"torque": 10.0}


def _torque(rng: np.random.Generator, scene: Scene, where: str) -> Values:
    return {"compliance": 0.1 * max(joint.compliance for joint in scene.arm.joints)}


_DRAWN: dict[str, Callable[[np.random.Generator, Scene, str], Values]] = {
    "gear_ripple": _ripple,
    "warm_up": _warm_up,
    "step": _step,
    "settling": _settling,
    "friction_windup": _friction,
    "measured_torque": _torque,
}
