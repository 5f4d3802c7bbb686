"""Causes of the catalogue by formulas that it does not use; such errors at all joints, and one more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from studies.research.withheld.causes import Cause, Foreign, Values
from studies.research.withheld.draw import EASY, Case, Draft, NoSuchCase
from studies.research.withheld.effects import segment
from studies.research.withheld.real_arms import (
    RealConditions,
    draw_real_scene,
    filled,
    plausible,
    sized_together,
)
from studies.research.withheld.robots import Array, draw_arm
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Action, State

SHARES = {"single": 0.5, "whole": 0.25, "mixture": 0.25}
_POSES, _ONE_MARKER = (28, 60), 0.2
_SMALL = 1e-4  # rad or m, before a size is found
_LAG = 1200.0  # s, by which links follow the air
_MINUTE = 60.0


def draw_foreign_case(rng: np.random.Generator, family: str) -> Case:
    """A case of one family: one cause, errors of one kind at all joints, or these and one more."""
    while True:
        arm = draw_arm(rng)
        conditions = RealConditions(
            **{**asdict(EASY), "configurations": int(rng.integers(*_POSES, endpoint=True))},
            visit="once",
            one_marker=rng.random() < _ONE_MARKER,
            background=False,
            torques=False,
            ratios_said=False,
            grid=False,
        )
        scene = draw_real_scene(rng, arm, conditions)
        try:
            return filled(rng, family, conditions, scene, _CAUSES)
        except NoSuchCase:
            continue


def joint_error(
    scene: Scene, k: int, dq: Array, effect: str, *others: str, values: Values | None = None
) -> Foreign:
    """An error (N,) of one joint, and the effects that are right."""

    def act(scene: Scene, state: State) -> Action:
        action = scene.nothing()
        action.joint[:, k] = _SMALL * dq
        return action

    where = scene.arm.names[k]
    alike = tuple(f"{other}:{where}" for other in others)
    return Foreign(effect, where, values or {}, act=act, alike=alike)


def base_motion(
    twist: Array, by: Array, effect: str, other: str = "", values: Values | None = None
) -> Foreign:
    """A motion (6,) of the base times (N,): a moving base and a moving instrument are the same."""

    def act(scene: Scene, state: State) -> Action:
        action = scene.nothing()
        action.twist[:, 0] = np.outer(by, _SMALL * twist)
        return action

    alike = (f"{other or effect}:instrument",)
    return Foreign(effect, "base", values or {}, act=act, alike=alike)


def any_twist(rng: np.random.Generator) -> Array:
    """A motion in any direction, of length one, shape (6,)."""
    drawn = rng.normal(size=6)
    return np.asarray(drawn / np.linalg.norm(drawn))


def phase(rng: np.random.Generator) -> float:
    """Any angle, rad."""
    return float(rng.uniform(0.0, 2.0 * np.pi))


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


OfJoint = Callable[[np.random.Generator, Scene, int], Foreign]


def _hysteresis(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """Friction that is won over gradually: tanh of the last move, or of its speed, over a knee."""
    moves = scene.session.moves
    share = moves[:, k]
    if rng.random() < 0.5 and not scene.arm.slides.any():  # metres and radians share no longest
        longest = np.abs(moves).max(axis=1)
        share = share / np.where(longest > 0.0, longest, 1.0)
    dq = np.tanh(share / rng.uniform(0.03, 0.15))
    return joint_error(scene, k, dq, "backlash", "friction_windup")


def _dead_band(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    dq = play_with_dead_band(scene.session.moves[:, k], float(rng.uniform(0.03, 0.2)))
    return joint_error(scene, k, dq, "backlash", "friction_windup")


def _sides(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    sides = float(rng.choice([-1.0, 1.0])) * scene.session.approach[:, k]
    return joint_error(scene, k, sides, "backlash", "friction_windup")


def _wheel(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    dq = eccentric(scene.session.q[:, k], phase(rng), float(rng.uniform(0.1, 0.7)), phase(rng))
    return joint_error(scene, k, dq, "transmission_harmonic")


def _fading_ripple(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """Twice a turn of the wave generator; the amplitude varies by a third about once a turn."""
    q, cycles = scene.session.q[:, k], 2.0 * scene.ratios[scene.arm.names[k]]
    dq = (1.0 + 0.33 * np.sin(q + phase(rng))) * np.sin(cycles * q + phase(rng))
    return joint_error(scene, k, dq, "gear_ripple", values={"cycles": cycles})


def _lag(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """A share of the last move is still to come."""
    return joint_error(scene, k, -scene.session.moves[:, k], "settling")


def _saturated_lag(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """The same, and no more after moves longer than a usual one."""
    moves = scene.session.moves[:, k]
    usual = float(np.median(np.abs(moves[moves != 0.0]))) * float(rng.uniform(0.8, 1.5))
    return joint_error(scene, k, -np.tanh(moves / usual), "settling")


def _spring(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """A drive that hardens. Raises NoSuchCase where nothing turns the joint."""
    where, share = scene.arm.names[k], float(rng.uniform(0.0, 0.45))
    if where in scene.modelled or not scene.arm.joints[k].compliance:
        raise NoSuchCase

    def act(scene: Scene, state: State) -> Action:
        action = scene.nothing()
        action.joint[:, k] = 1e-6 * hardening(state.torque[:, k], share)
        return action

    return Foreign("joint_compliance", where, {}, act=act)


def _warm_up(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """Two masses that warm at a pace of their own, of a joint or beneath the base."""
    t = scene.clock
    short, long = rng.uniform(6.0, 12.0) * _MINUTE, rng.uniform(25.0, 50.0) * _MINUTE
    share = float(rng.uniform(0.3, 0.6))
    left = np.asarray(share * np.exp(-t / short) + (1.0 - share) * np.exp(-t / long))
    if rng.random() < 0.5:
        return joint_error(scene, k, left, "warm_up")
    return base_motion(any_twist(rng), left, "warm_up")


def _foundation(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    left = np.exp(-((scene.clock / (rng.uniform(15.0, 40.0) * _MINUTE)) ** 0.6))
    return base_motion(any_twist(rng), left, "warm_up")


def _oblique(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """The base turns about an axis that is neither upright nor level and passes beside it."""
    axis = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.35, 1.0, 3)
    axis /= np.linalg.norm(axis)
    twist = np.concatenate([np.cross(rng.uniform(-0.6, 0.6, 3), axis), axis])
    left = np.exp(-scene.clock / (rng.uniform(12.0, 45.0) * _MINUTE))
    return base_motion(twist, left, "warm_up")


def _drift(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    return base_motion(any_twist(rng), scene.session.hours, "base_drift", "tracker_drift")


def _step(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """A jump that takes a minute or two."""
    t = scene.clock
    at, width = float(rng.uniform(0.15, 0.85) * t[-1]), rng.uniform(0.5, 2.0) * _MINUTE
    jump = np.asarray(0.5 * (1.0 + np.tanh((t - at) / width)))
    if rng.random() < 0.5:
        return joint_error(scene, k, jump, "step", values={"at": at})
    return base_motion(any_twist(rng), jump, "step", values={"at": at})


def _heat(rng: np.random.Generator, scene: Scene, k: int) -> Foreign:
    """Links that follow the air by twenty minutes, and grow by 1 um/(m K) at size one."""
    degrees = lagging(scene.session.temperature, scene.session.time, _LAG) - 20.0

    def act(scene: Scene, state: State) -> Action:
        action = scene.nothing()
        for frame in range(1, scene.arm.dof + 2):
            action.twist[:, frame, :3] = np.outer(degrees, 1e-6 * segment(scene, frame))
        return action

    return Foreign("thermal_expansion", "arm", {}, act=act)


KINDS: tuple[OfJoint, ...] = (
    _hysteresis,
    _dead_band,
    _wheel,
    _fading_ripple,
    _lag,
    _saturated_lag,
    _spring,
    _warm_up,
    _foundation,
    _oblique,
    _drift,
    _step,
    _heat,
)
_WHOLE: tuple[OfJoint, ...] = (_sides, _fading_ripple, _wheel)


def _turning(scene: Scene) -> list[int]:
    return [k for k, joint in enumerate(scene.arm.joints) if not joint.slides]


def _one_of(kinds: tuple[OfJoint, ...], rng: np.random.Generator, scene: Scene) -> Foreign:
    kind = kinds[int(rng.integers(len(kinds)))]
    return kind(rng, scene, int(rng.choice(_turning(scene))))


def _single(draft: Draft) -> list[Cause]:
    return [plausible(draft, lambda rng, scene: _one_of(KINDS, rng, scene))]


def _whole(draft: Draft) -> list[Cause]:
    """The like at every joint that turns, some twice as large as others."""
    rng, scene = draft.rng, draft.scene
    kind = _WHOLE[int(rng.integers(len(_WHOLE)))]
    made = [kind(rng, scene, k) for k in _turning(scene)]
    return sized_together(draft, [c.sized(float(rng.lognormal(0.0, 0.35))) for c in made])


def _mixture(draft: Draft) -> list[Cause]:
    family = _whole(draft)
    further = (_spring,) if family[0].effect == "transmission_harmonic" else (_spring, _wheel)
    single = plausible(draft, lambda rng, scene: _one_of(further, rng, scene))
    return [*family, single]


_CAUSES: dict[str, Callable[[Draft], list[Cause]]] = {
    "single": _single,
    "whole": _whole,
    "mixture": _mixture,
}
