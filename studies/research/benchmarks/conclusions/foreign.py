"""Causes of the catalogue by formulas that it does not use; hard kinds, errors of all joints, pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from studies.research.benchmarks.conclusions.days import (
    NONCENTRALITY,
    VISIBLE,
    Act,
    Day,
    NoSuchDay,
    TrueCause,
    Visibility,
    arm_of,
    base_motion,
    by_turns,
    drawn_noncentrality,
    joint_error,
    named,
    random_poses,
    ripple_names,
    scattering,
    scene_of,
    tuned,
)
from studies.research.benchmarks.day import reflectors
from studies.research.withheld.effects import segment
from studies.research.withheld.judge import Entry
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Action, State
from studies.research.withheld.visible import at_rest


def smooth_hysteresis(moves: Array, knee: float) -> Array:
    """Friction that is won over gradually: tanh of the last move over a knee."""
    return np.tanh(moves / knee)


def hysteresis_by_rate(moves: Array, longest: Array, knee: float) -> Array:
    """The same by the speed of arrival, which is the joint's share of the longest move."""
    return np.tanh(moves / np.where(longest > 0.0, longest, 1.0) / knee)


def play_with_dead_band(moves: Array, band: float) -> Array:
    """Side of a play that only moves longer than a band turn over; shape (N,)."""
    sides, side = np.zeros(len(moves)), 0.0
    for i, move in enumerate(moves):
        side = float(np.sign(move)) if abs(move) > band else side
        sides[i] = side
    return sides


def eccentric(q: Array, phase: float, second: float, second_phase: float) -> Array:
    """Angle error of a wheel off its centre, exact in the eccentricity, and of an oval one."""
    turn = q - phase
    off = np.sin(turn) / (1.0 - 0.1 * np.cos(turn))
    return np.asarray(off + second * np.sin(2.0 * q - second_phase))


def hardening(torque: Array, share: float) -> Array:
    """Torque less a cubic, which takes a share of the largest torque's effect."""
    most = float(np.abs(torque).max()) or 1.0
    return np.asarray(torque * (1.0 - share * (torque / most) ** 2))


def lagging(temperature: Array, time: Array, lag: float) -> Array:
    """What follows a temperature with a time constant [s], in balance at first; shape (N,)."""
    follows = np.empty_like(temperature)
    follows[0] = temperature[0]
    for i in range(1, len(time)):
        keep = np.exp(-(time[i] - time[i - 1]) / lag)
        follows[i] = keep * follows[i - 1] + (1.0 - keep) * temperature[i]
    return follows


def fading_ripple(q: Array, cycles: float, phase: float, fade: float) -> Array:
    """A ripple whose amplitude varies by a third about once a turn."""
    return np.asarray((1.0 + 0.33 * np.sin(q + fade)) * np.sin(cycles * q + phase))


def two_constants(time: Array, short: float, long: float, share: float) -> Array:
    """What is left of a warm-up of two masses."""
    t = time - time[0]
    return np.asarray(share * np.exp(-t / short) + (1.0 - share) * np.exp(-t / long))


def stretched(time: Array, tau: float) -> Array:
    """What is left of a foundation's settling: exp(-(t / tau)^0.6)."""
    return np.asarray(np.exp(-(((time - time[0]) / tau) ** 0.6)))


def smooth_step(time: Array, at: float, width: float) -> Array:
    """From 0 to 1 about a moment, within some widths [s]."""
    return np.asarray(0.5 * (1.0 + np.tanh((time - at) / width)))


def growing(degrees: Array) -> Act:
    """Links that grow with (N,) kelvins, by 1 um/(m K) at size one."""

    def act(scene: Scene, state: State) -> Action:  # noqa: ARG001
        action = scene.nothing()
        for frame in range(1, scene.arm.dof + 2):
            action.twist[:, frame, :3] = np.outer(degrees, 1e-6 * segment(scene, frame))
        return action

    return act


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
        dq = smooth_hysteresis(moves[:, k], float(rng.uniform(0.03, 0.15)))
    else:
        longest = np.abs(moves).max(axis=1)
        dq = hysteresis_by_rate(moves[:, k], longest, float(rng.uniform(0.03, 0.12)))
    return at_joint(scene, k, "hysteresis", dq, "backlash", "friction_windup")


def _dead_band(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    dq = play_with_dead_band(scene.session.moves[:, k], float(rng.uniform(0.03, 0.2)))
    return at_joint(scene, k, "dead_band", dq, "backlash", "friction_windup")


def _eccentric(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    second, phases = float(rng.uniform(0.2, 0.7)), rng.uniform(0.0, 2.0 * np.pi, 2)
    dq = eccentric(scene.session.q[:, k], phases[0], second, phases[1])
    cause = at_joint(scene, k, "eccentric", dq, "transmission_harmonic")
    (alike,) = named(cause.where, "gear_ripple")  # of one cycle a turn: the same
    once = tuned(alike, "cycles", 1.0, "1/turn", 0.1)
    return TrueCause(cause.kind, cause.where, cause.act, (*cause.names, once))


def _spring(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:
    k, share = loaded(rng, scene, still), float(rng.uniform(0.15, 0.45))

    def act(scene: Scene, state: State) -> Array:  # noqa: ARG001
        return 1e-6 * hardening(state.torque[:, k], share)

    where = scene.arm.names[k]
    return TrueCause("spring", where, joint_error(k, act), named(where, "joint_compliance"))


def _heat(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    session = scene.session
    degrees = lagging(session.temperature, session.time, _LAG) - 20.0
    return TrueCause("heat", "arm", growing(degrees), named("arm", "thermal_expansion"))


def _ripple(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    k = turning(rng, scene)
    cycles = 2.0 * scene.ratios[scene.arm.names[k]]
    dq = fading_ripple(scene.session.q[:, k], cycles, *rng.uniform(0.0, 2.0 * np.pi, 2))
    where, act = scene.arm.names[k], joint_error(k, lambda *_: _SMALL * dq)
    return TrueCause("ripple", where, act, ripple_names(scene, k, cycles))


def _warm_up(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    short, long = rng.uniform(6.0, 12.0) * _MINUTE, rng.uniform(25.0, 50.0) * _MINUTE
    share = float(rng.uniform(0.3, 0.6))
    left = two_constants(scene.session.time, short, long, share)
    if rng.random() < 0.5:
        return at_joint(scene, turning(rng, scene), "warm_up", left, "warm_up")
    act = base_motion(twist(rng), lambda _: left)
    return TrueCause("warm_up", "base", act, base_or_instrument("warm_up"))


def _settling(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    left = stretched(scene.session.time, rng.uniform(15.0, 40.0) * _MINUTE)
    act = base_motion(twist(rng), lambda _: left)
    return TrueCause("base_settling", "base", act, base_or_instrument("warm_up"))


def _step(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    time = scene.session.time - scene.session.time[0]
    at, width = rng.uniform(0.15, 0.85) * time[-1], rng.uniform(0.5, 2.0) * _MINUTE
    near = 3.0 * time[-1] / (len(time) - 1) + width
    jump = smooth_step(time, at, width)
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


_FAINT = (60.0, 100.0)

MakeAll = Callable[[np.random.Generator, Scene, State], list[TrueCause]]


def _draw_hard(rng: np.random.Generator, kind: str, scatters: bool) -> Day:
    day, still = plain_day(rng, kind, scatters)
    visible = Visibility(day.scene, day.mechanism, still)
    within = _FAINT if kind == "settling" else NONCENTRALITY
    made = _MAKE_HARD[kind](rng, day.scene, still)
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


def _lagging(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
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


def _of_all(one: Callable[[np.random.Generator, Scene, int], TrueCause]) -> MakeAll:
    """The like at every joint that turns, some twice as large as others."""

    def make(rng: np.random.Generator, scene: Scene, still: State) -> list[TrueCause]:  # noqa: ARG001
        turns = np.flatnonzero(~scene.arm.slides)
        made = [one(rng, scene, int(k)) for k in turns]
        return [cause.sized(float(rng.lognormal(0.0, 0.35))) for cause in made]

    return make


def _backlash_of(rng: np.random.Generator, scene: Scene, k: int) -> TrueCause:
    sides = float(rng.choice([-1.0, 1.0])) * scene.session.approach[:, k]
    return at_joint(scene, k, "backlash", sides, "backlash", "friction_windup")


def _ripple_of(rng: np.random.Generator, scene: Scene, k: int) -> TrueCause:
    """Twice a turn of the wave generator."""
    where = scene.arm.names[k]
    cycles, phase = 2.0 * scene.ratios[where], float(rng.uniform(0.0, 2.0 * np.pi))
    dq = 1e-4 * np.sin(cycles * scene.session.q[:, k] + phase)
    names = ripple_names(scene, k, cycles)
    return TrueCause("ripple", where, joint_error(k, lambda *_: dq), names)


def _gear_of(rng: np.random.Generator, scene: Scene, k: int) -> TrueCause:
    phases, second = rng.uniform(0.0, 2.0 * np.pi, 2), float(rng.uniform(0.1, 0.4))
    dq = eccentric(scene.session.q[:, k], phases[0], second, phases[1])
    return at_joint(scene, k, "gear", dq, "transmission_harmonic")


def _compliance(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:
    k = loaded(rng, scene, still)
    where = scene.arm.names[k]

    def yields(scene: Scene, state: State) -> Array:  # noqa: ARG001
        return np.asarray(1e-6 * state.torque[:, k])

    return TrueCause("spring", where, joint_error(k, yields), named(where, "joint_compliance"))


def _one_gear(rng: np.random.Generator, scene: Scene, still: State) -> TrueCause:  # noqa: ARG001
    return _gear_of(rng, scene, turning(rng, scene))


_MAKE_HARD: dict[str, MakeAll] = {
    "oblique": _oblique,
    "settling": _lagging,
    "drift": _drift,
    "saturated": _saturated,
    "backlashes": _of_all(_backlash_of),
    "ripples": _of_all(_ripple_of),
    "gears": _of_all(_gear_of),
    "backlashes_gear": _of_all(_backlash_of),
    "ripples_spring": _of_all(_ripple_of),
    "gears_spring": _of_all(_gear_of),
}
_BESIDE: dict[str, Callable[[np.random.Generator, Scene, State], TrueCause]] = {
    "backlashes_gear": _one_gear,
    "ripples_spring": _compliance,
    "gears_spring": _compliance,
}
HARD_KINDS = tuple(_MAKE_HARD)
draw_hard = by_turns(HARD_KINDS, _draw_hard)
