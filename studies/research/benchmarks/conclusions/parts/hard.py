"""Kinds that are missed or misnamed more often than others, errors of all joints at once, and pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from studies.research.benchmarks.conclusions import formulas
from studies.research.benchmarks.conclusions.days import Day, by_turns
from studies.research.benchmarks.conclusions.parts.foreign import (
    at_joint,
    base_or_instrument,
    loaded,
    plain_day,
    turning,
    twist,
)
from studies.research.benchmarks.conclusions.sizing import (
    NONCENTRALITY,
    VISIBLE,
    NoSuchDay,
    Visibility,
    drawn_noncentrality,
)
from studies.research.benchmarks.conclusions.true_causes import (
    TrueCause,
    base_motion,
    joint_error,
    named,
    ripple_names,
)
from studies.research.withheld.actions import State
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene

_FAINT = (60.0, 100.0)
_MINUTE = 60.0

Make = Callable[[np.random.Generator, Scene, State], list[TrueCause]]


def _draw(rng: np.random.Generator, kind: str, scatters: bool) -> Day:
    day, still = plain_day(rng, kind, scatters)
    visible = Visibility(day.scene, day.mechanism, still)
    within = _FAINT if kind == "settling" else NONCENTRALITY
    made = _MAKE[kind](rng, day.scene, still)
    causes = visible.all_sized(made, drawn_noncentrality(rng, within))
    family = len(causes) if len(causes) > 1 else 0
    if family and sum(n > VISIBLE for n in visible.beside(causes)) < 2:
        raise NoSuchDay
    if kind in _BESIDE:
        single = _BESIDE[kind](rng, day.scene, still)
        causes += [visible.sized(single, drawn_noncentrality(rng))]
    beside = tuple(visible.beside(causes))
    return replace(day, causes=tuple(causes), noncentrality=beside, family=family)


def _oblique(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
    """The base turns about an axis that is neither upright nor level and passes beside it."""
    axis = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.35, 1.0, 3)
    axis /= np.linalg.norm(axis)
    beside = rng.uniform(-0.6, 0.6, 3)
    motion = 1e-4 * np.concatenate([np.cross(beside, axis), axis])
    t = scene.session.time - scene.session.time[0]
    left = np.exp(-t / (rng.uniform(12.0, 45.0) * _MINUTE))
    act = base_motion(motion, lambda _: left)
    return [TrueCause("oblique", "base", act, base_or_instrument("warm_up"))]


def _settling(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
    """A share of the last move is still to come."""
    k = turning(rng, scene)
    return [at_joint(scene, k, "settling", -scene.session.moves[:, k], "settling")]


def _saturated(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
    """The same, and no more after moves longer than a usual one."""
    k = turning(rng, scene)
    moves = scene.session.moves[:, k]
    usual = float(np.median(np.abs(moves[moves != 0.0]))) * float(rng.uniform(0.8, 1.5))
    return [at_joint(scene, k, "saturated", -np.tanh(moves / usual), "settling")]


def _drift(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
    """The base moves evenly all day."""
    act = base_motion(twist(rng), lambda scene: scene.session.hours)
    names = (*named("base", "base_drift"), *named("instrument", "tracker_drift"))
    return [TrueCause("drift", "base", act, names)]


def _of_all(one: Callable[[np.random.Generator, Scene, int], TrueCause]) -> Make:
    """The like at every joint that turns, some twice as large as others."""

    def make(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
        turns = np.flatnonzero(~scene.arm.slides)
        made = [one(rng, scene, int(k)) for k in turns]
        return [cause.sized(float(rng.lognormal(0.0, 0.35))) for cause in made]

    return make


def _backlash(rng: np.random.Generator, scene: Scene, k: int) -> TrueCause:
    sides = float(rng.choice([-1.0, 1.0])) * scene.session.approach[:, k]
    return at_joint(scene, k, "backlash", sides, "backlash", "friction_windup")


def _ripple(rng: np.random.Generator, scene: Scene, k: int) -> TrueCause:
    """Twice a turn of the wave generator."""
    where = scene.arm.names[k]
    cycles, phase = 2.0 * scene.ratios[where], float(rng.uniform(0.0, 2.0 * np.pi))
    dq = 1e-4 * np.sin(cycles * scene.session.q[:, k] + phase)
    names = ripple_names(scene, k, cycles)
    return TrueCause("ripple", where, joint_error(k, lambda *_: dq), names)


def _gear(rng: np.random.Generator, scene: Scene, k: int) -> TrueCause:
    phases, second = rng.uniform(0.0, 2.0 * np.pi, 2), float(rng.uniform(0.1, 0.4))
    dq = formulas.eccentric(scene.session.q[:, k], phases[0], second, phases[1])
    return at_joint(scene, k, "gear", dq, "transmission_harmonic")


def _compliance(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:
    k = loaded(rng, scene, still)
    where = scene.arm.names[k]

    def yields(scene: Scene, state: State) -> Array:  # noqa: ARG001
        return np.asarray(1e-6 * state.torque[:, k])

    return TrueCause("spring", where, joint_error(k, yields), named(where, "joint_compliance"))


def _one_gear(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    return _gear(rng, scene, turning(rng, scene))


_MAKE: dict[str, Make] = {
    "oblique": _oblique,
    "settling": _settling,
    "drift": _drift,
    "saturated": _saturated,
    "backlashes": _of_all(_backlash),
    "ripples": _of_all(_ripple),
    "gears": _of_all(_gear),
    "backlashes_gear": _of_all(_backlash),
    "ripples_spring": _of_all(_ripple),
    "gears_spring": _of_all(_gear),
}
_BESIDE: dict[str, Callable[[np.random.Generator, Scene, State], TrueCause]] = {
    "backlashes_gear": _one_gear,
    "ripples_spring": _compliance,
    "gears_spring": _compliance,
}
KINDS = tuple(_MAKE)
draw = by_turns(KINDS, _draw)
