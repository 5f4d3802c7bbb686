"""One cause of the catalogue a day, by another formula than the catalogue's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from studies.research.benchmarks.conclusions import formulas
from studies.research.benchmarks.conclusions.arms import arm_of
from studies.research.benchmarks.conclusions.days import Day, by_turns
from studies.research.benchmarks.conclusions.scenes import (
    random_poses,
    reflectors,
    scattering,
    scene_of,
)
from studies.research.benchmarks.conclusions.sizing import (
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
    tuned,
)
from studies.research.withheld.actions import State
from studies.research.withheld.match import Entry
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.visible import at_rest

ARMS = ("light", "heavy", "rail", "seven", "scara", "ur_on_track")
_POSES = (28, 60)
_SHARE = (0.45, 1.0)  # of the joints' ranges that the cell leaves free
_ONE_MARKER = 0.2  # share of the days
_MOST = 1.5  # scatter over noise
_SMALL = 1e-4  # rad or m, before a size is found
_LAG = 1200.0
_MINUTE = 60.0

Make = Callable[[np.random.Generator, Scene, State], TrueCause]


def _draw(rng: np.random.Generator, kind: str, scatters: bool) -> Day:
    day, still = plain_day(rng, kind, scatters)
    visible = Visibility(day.scene, day.mechanism, still)
    cause = visible.sized(_MAKE[kind](rng, day.scene, still), drawn_noncentrality(rng))
    return replace(day, causes=(cause,), noncentrality=(visible.alone(cause),))


def plain_day(rng: np.random.Generator, kind: str, scatters: bool) -> tuple[Day, State]:
    """An arm on its day before anything is wrong, and how it stands then."""
    arm = arm_of(str(rng.choice(ARMS)))
    share = float(rng.uniform(*_SHARE))
    q = random_poses(rng, arm, int(rng.integers(_POSES[0], _POSES[1] + 1)), share)
    guesses = reflectors(rng, arm, 1 if rng.random() < _ONE_MARKER else 3)
    scene = scene_of(rng, arm, q, guesses, sigma=arm.sigma)
    mechanism = scene.mechanism()
    still = at_rest(scene, mechanism, ())
    ratio = float(rng.uniform(0.0, _MOST)) if scatters else 0.0
    scene = scattering(rng, scene, still, ratio * arm.sigma, bool(rng.random() < 0.5))
    more = {"share": share, "markers": len(guesses)}
    return Day(kind, scene, mechanism, ratio=ratio, more=more), still


def turning(rng: np.random.Generator, scene: Scene) -> int:
    """A joint that turns, any."""
    return int(rng.choice([k for k, joint in enumerate(scene.arm.joints) if not joint.slides]))


def loaded(rng: np.random.Generator, scene: Scene, still: State) -> int:
    """A joint that turns and carries a torque that changes. Raises NoSuchDay."""
    spread = np.std(still.torque, axis=0) * ~scene.arm.slides
    if spread.max() < 0.1:
        raise NoSuchDay
    return int(rng.choice(np.flatnonzero(spread > 0.2 * spread.max())))


def twist(rng: np.random.Generator) -> Array:
    """A small motion of the base in any direction, shape (6,), m and rad."""
    drawn = rng.normal(size=6)
    return np.asarray(_SMALL * drawn / np.linalg.norm(drawn))


def at_joint(scene: Scene, k: int, kind: str, dq: Array, *effects: str) -> TrueCause:
    """A joint's error (N,) with the effects that are right."""
    where = scene.arm.names[k]
    act = joint_error(k, lambda *_: _SMALL * dq)
    return TrueCause(kind, where, act, named(where, *effects))


def _hysteresis(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    moves = scene.session.moves
    if rng.random() < 0.5 or scene.arm.slides.any():  # metres and radians share no longest move
        dq = formulas.smooth_hysteresis(moves[:, k], float(rng.uniform(0.03, 0.15)))
    else:
        longest = np.abs(moves).max(axis=1)
        dq = formulas.hysteresis_by_rate(moves[:, k], longest, float(rng.uniform(0.03, 0.12)))
    return at_joint(scene, k, "hysteresis", dq, "backlash", "friction_windup")


def _dead_band(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    dq = formulas.play_with_dead_band(scene.session.moves[:, k], float(rng.uniform(0.03, 0.2)))
    return at_joint(scene, k, "dead_band", dq, "backlash", "friction_windup")


def _eccentric(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    second, phases = float(rng.uniform(0.2, 0.7)), rng.uniform(0.0, 2.0 * np.pi, 2)
    dq = formulas.eccentric(scene.session.q[:, k], phases[0], second, phases[1])
    cause = at_joint(scene, k, "eccentric", dq, "transmission_harmonic")
    (alike,) = named(cause.where, "gear_ripple")  # of one cycle a turn: the same
    once = tuned(alike, "cycles", 1.0, "1/turn", 0.1)
    return TrueCause(cause.kind, cause.where, cause.act, (*cause.names, once))


def _spring(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:
    k, share = loaded(rng, scene, still), float(rng.uniform(0.15, 0.45))

    def act(scene: Scene, state: State) -> Array:  # noqa: ARG001
        return 1e-6 * formulas.hardening(state.torque[:, k], share)

    where = scene.arm.names[k]
    return TrueCause("spring", where, joint_error(k, act), named(where, "joint_compliance"))


def _heat(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    session = scene.session
    degrees = formulas.lagging(session.temperature, session.time, _LAG) - 20.0
    return TrueCause("heat", "arm", formulas.growing(degrees), named("arm", "thermal_expansion"))


def _ripple(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    cycles = 2.0 * scene.ratios[scene.arm.names[k]]
    dq = formulas.fading_ripple(scene.session.q[:, k], cycles, *rng.uniform(0.0, 2.0 * np.pi, 2))
    where, act = scene.arm.names[k], joint_error(k, lambda *_: _SMALL * dq)
    return TrueCause("ripple", where, act, ripple_names(scene, k, cycles))


def _warm_up(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    short, long = rng.uniform(6.0, 12.0) * _MINUTE, rng.uniform(25.0, 50.0) * _MINUTE
    share = float(rng.uniform(0.3, 0.6))
    left = formulas.two_constants(scene.session.time, short, long, share)
    if rng.random() < 0.5:
        return at_joint(scene, turning(rng, scene), "warm_up", left, "warm_up")
    act = base_motion(twist(rng), lambda _: left)
    return TrueCause("warm_up", "base", act, base_or_instrument("warm_up"))


def _settling(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    left = formulas.stretched(scene.session.time, rng.uniform(15.0, 40.0) * _MINUTE)
    act = base_motion(twist(rng), lambda _: left)
    return TrueCause("base_settling", "base", act, base_or_instrument("warm_up"))


def _step(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    time = scene.session.time - scene.session.time[0]
    at, width = rng.uniform(0.15, 0.85) * time[-1], rng.uniform(0.5, 2.0) * _MINUTE
    near = 3.0 * time[-1] / (len(time) - 1) + width
    jump = formulas.smooth_step(time, at, width)
    if rng.random() < 0.5:
        cause = at_joint(scene, turning(rng, scene), "step", jump, "step")
    else:
        act = base_motion(twist(rng), lambda _: jump)
        cause = TrueCause("step", "base", act, base_or_instrument("step"))
    names = tuple(tuned(name, "at", at, "s", near) for name in cause.names)
    return TrueCause(cause.kind, cause.where, cause.act, names)


def base_or_instrument(effect: str) -> tuple[Entry, ...]:
    """A moving base and a moving instrument are one and the same."""
    return (*named("base", effect), *named("instrument", effect))


_MAKE: dict[str, Make] = {
    "hysteresis": _hysteresis,
    "eccentric": _eccentric,
    "spring": _spring,
    "heat": _heat,
    "ripple": _ripple,
    "dead_band": _dead_band,
    "warm_up": _warm_up,
    "base_settling": _settling,
    "step": _step,
}
KINDS = tuple(_MAKE)
draw = by_turns(KINDS, _draw)
