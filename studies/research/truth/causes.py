"""A cause at a place with its size, and how one is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from studies.research.truth.effects import (
    BEYOND,
    EFFECTS,
    FIRST,
    LATER,
    OUTSIDE,
    TUNED,
    Sizes,
    direction,
    drive,
    formula_of,
    moment,
    places,
    sign,
)
from studies.research.truth.formulas import AXES
from studies.research.truth.mechanism import Action, State
from studies.research.truth.scene import Scene

_LATER_SHARE = 0.7  # of the causes of real arms
# What the catalogue came to hold: no causes outside it any more.
_HELD = ("third_harmonic", "slipped_joint", "settling_base")
_NO_ANGLES = (*AXES[:3], *TUNED)


class Unsuitable(Exception):
    """A scene cannot have a cause, or not as visible as it was drawn."""


@dataclass(frozen=True, eq=False)
class Cause:
    """Linear in its size.

    effect, where : names; ``values`` : SI, of a cause of size one
    size : factor on what it does
    shape : joint whose angle modulates it and phase [rad] of a wrong shape, or None
    act : what it does at size one where another formula than the catalogue's says so; values are those
        of tuned parameters alone then; alike : further names that are right
    """

    effect: str
    where: str
    values: Sizes
    size: float = 1.0
    shape: tuple[int, float] | None = None
    act: Callable[[Scene, State], Action] | None = None
    alike: tuple[str, ...] = ()

    @property
    def scored(self) -> bool:
        """Whether intervals of its parameters are to hold their values."""
        return self.shape is None and self.act is None

    def sized(self, factor: float) -> Self:
        """The same, so many times as large."""
        return replace(self, size=self.size * factor)

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""
        factor = np.full(scene.count, self.size)
        if self.shape is not None:
            joint, phase = self.shape
            factor *= 1.0 + 0.35 * np.sin(2.0 * scene.session.q[:, joint] + phase)
        if self.act is None:
            action.add(formula_of(self.effect)(scene, state, self.where, self.values), factor)
        else:
            action.add(self.act(scene, state), factor)


Draw = Callable[[np.random.Generator, Scene], Cause]


def cause_at(rng: np.random.Generator, scene: Scene, kind: str, where: str) -> Cause:
    """One of a kind at a place."""
    return Cause(kind, where, EFFECTS[kind].unit(rng, scene, where))


def draw_cause(rng: np.random.Generator, scene: Scene) -> Cause:
    """An effect of the first catalogue at one of its places.

    Between drawing among kinds and drawing among places: kinds that have one place are seen often
    enough to be judged, and do not crowd out the rest. What few scenes allow is frequent in those.
    """
    found = places(scene, FIRST)
    weight = np.array([len(where) for where in found.values()]) ** 0.75
    weight *= [3.0 if FIRST[kind].rare else 1.0 for kind in found]
    kind = str(rng.choice(list(found), p=weight / weight.sum()))
    return cause_at(rng, scene, kind, str(rng.choice(found[kind])))


def draw_real(rng: np.random.Generator, scene: Scene) -> Cause:
    """An effect of the whole catalogue, more often one of those that came later."""
    if rng.random() > _LATER_SHARE:
        return draw_cause(rng, scene)
    found = places(scene, LATER)
    kind = str(rng.choice(list(found)))
    return cause_at(rng, scene, kind, str(rng.choice(found[kind])))


def with_wrong_shape(rng: np.random.Generator, scene: Scene, cause: Cause) -> Cause:
    """The same cause, modulated by 35 % with the angle of its joint, or of any other."""
    names = scene.arm.names
    joint = names.index(cause.where) if cause.where in names else int(rng.integers(len(names)))
    return replace(cause, shape=(joint, float(rng.uniform(0.0, 2.0 * np.pi))))


def outside_here(scene: Scene) -> list[str]:
    """Kinds of no catalogue whose variable the files of a scene show."""
    return [name for name, kind in OUTSIDE.items() if kind.needs in ("", *scene.conditions.columns)]


def draw_outside(rng: np.random.Generator, scene: Scene) -> Cause:
    """A cause that the catalogue does not hold."""
    return outside_of(rng, scene, str(rng.choice(outside_here(scene))))


def outside_of(rng: np.random.Generator, scene: Scene, name: str) -> Cause:
    """One of a kind outside the catalogue."""
    kind, arm = OUTSIDE[name], scene.arm
    if kind.at == "marker":
        where = f"marker:m{rng.integers(len(scene.markers)) + 1}"
        return Cause(name, where, direction(rng, AXES[:3], 5e-5))
    size = kind.size * (drive(scene) if name == "creep" else 1.0)
    values = {"a": size * sign(rng)}
    if kind.b is not None:
        values["b"] = float(rng.uniform(*kind.b))
    if kind.at in ("base", "instrument"):
        return Cause(name, kind.at, values)
    # The first two joints of a chain carry no torque where they stand upright.
    soft = [k for k, joint in enumerate(arm.joints) if joint.compliance]
    turns = [k for k, joint in enumerate(arm.joints) if not joint.slides and k > 0]
    k = int(rng.choice(soft if kind.at == "soft" else turns))
    if name == "damaged_teeth":
        low, high = arm.limits[k]
        values["b"] = float(rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high))
    if name == "third_harmonic":
        values = direction(rng, ("a", "b"))
    if kind.at == "soft":
        values["a"] = abs(values["a"])
    return Cause(name, arm.names[k], values)


def draw_beyond(rng: np.random.Generator, scene: Scene) -> Cause:
    """A cause that the catalogue does not hold, one of the further ones every other time."""
    if rng.random() < 0.5:
        usual = [kind for kind in outside_here(scene) if kind not in _HELD]
        return outside_of(rng, scene, str(rng.choice([k for k in usual if _possible(scene, k)])))
    kinds = [kind for kind in BEYOND if kind != "cable_force" or scene.modelled]
    kind = str(rng.choice(kinds))
    turns = [j.name for k, j in enumerate(scene.arm.joints) if not j.slides and k > 0]
    joint = str(rng.choice(turns))
    if kind == "two_jumps":
        both = {"offset": 1e-4 * sign(rng), "at": moment(rng, scene)}
        return Cause(kind, joint, {**both, **direction(rng, AXES)})
    if kind == "random_walk":
        return Cause(kind, "base", {"a": 1e-5, "seed": float(rng.integers(1 << 30))})
    if kind == "cable_force":
        reach = float(np.sum(np.linalg.norm([j.xyz for j in scene.arm.joints], axis=1)))
        anchor = rng.uniform((-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)) * reach
        return Cause(kind, "tip", {"a": 10.0, **dict(zip("xyz", anchor.tolist(), strict=True))})
    return Cause(kind, joint, {"a": 1e-4, "b": float(rng.uniform(0.15, 0.5))})


def _possible(scene: Scene, kind: str) -> bool:
    """What sits in a drive needs one that yields; what moves one reflector needs another beside it."""
    if OUTSIDE[kind].at == "soft":
        return bool(scene.arm.soft)
    return OUTSIDE[kind].at != "marker" or len(scene.markers) > 1


def absurd(scene: Scene, cause: Cause, size: float) -> bool:
    """Masses and compliances below nothing, sizes far from what anyone would believe."""
    if cause.effect not in EFFECTS:
        return False
    values = {name: size * value for name, value in cause.values.items()}
    most = EFFECTS[cause.effect].most
    if any(abs(value) > most[name] for name, value in values.items() if name in most):
        return True
    if cause.effect == "link_weight":
        return abs(values["mass"]) > 0.6 * float(scene.arm.masses[scene.index(cause.where)])
    if cause.effect == "payload":
        com = max(abs(values.get(f"com_{c}", 0.0)) for c in "xyz")
        mass = abs(values.get("mass", 0.0)) / max(scene.payload, 1e-9)
        return abs(values.get("scale", 0.0)) > 0.5 or mass > 0.9 or com > scene.arm.tool
    if cause.effect == "gravity_sag":
        return values["weight"] > 2.0
    if cause.effect == "stiffness_vs_angle":
        return min(values.values()) < -0.9 * float(scene.compliance[scene.index(cause.where)])
    return False


def too_rough(cause: Cause) -> bool:
    """Larger, in all its angles together, than anyone would believe of a real arm."""
    if cause.effect not in EFFECTS:
        return False
    length = [v * cause.size for name, v in cause.values.items() if name not in _NO_ANGLES]
    return float(np.linalg.norm(length)) > EFFECTS[cause.effect].believed
