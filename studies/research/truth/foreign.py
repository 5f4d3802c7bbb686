"""Causes of the catalogue by formulas that it does not use, each at a joint of a scene.

The program cannot fit them exactly, so that nothing rewards it for sharing a formula with the truth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from studies.research.truth.arms import Array
from studies.research.truth.causes import Cause, Unsuitable
from studies.research.truth.effects import Sizes
from studies.research.truth.formulas import grown, lagging, moved_frame, share_of_longest, turned
from studies.research.truth.scene import Scene

SMALL = 1e-4  # rad or m, before a size is found
_LAG = 1200.0  # s, by which links follow the air
_MINUTE = 60.0
Rng = np.random.Generator
Formula = Callable[[Rng, Scene, int], Cause]
Signal = Callable[[Rng, Scene, int], Array]


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


def _at_joint(
    scene: Scene, k: int, dq: Array, effect: str, *others: str, values: Sizes | None = None
) -> Cause:
    """An error (N,) of one joint, and the effects that are right."""
    where = scene.arm.names[k]
    alike = tuple(f"{other}:{where}" for other in others)
    act = lambda scene, _: turned(scene, where, SMALL * dq)  # noqa: E731
    return Cause(effect, where, values or {}, act=act, alike=alike)


def _at_base(
    rng: Rng, by: Array, effect: str, other: str = "", values: Sizes | None = None,
    twist: Array | None = None,
) -> Cause:  # fmt: skip
    """A motion of the base, in any direction unless said, times (N,): the instrument's are alike."""
    if twist is None:
        drawn = rng.normal(size=6)
        twist = drawn / np.linalg.norm(drawn)
    moved = np.outer(by, SMALL * twist)
    alike = (f"{other or effect}:instrument",)
    act = lambda scene, _: moved_frame(scene, 0, moved)  # noqa: E731
    return Cause(effect, "base", values or {}, act=act, alike=alike)


def _phase(rng: Rng) -> float:
    return float(rng.uniform(0.0, 2.0 * np.pi))


def _moves(scene: Scene, k: int) -> Array:
    return scene.session.moves[:, k]


def _hysteresis(rng: Rng, scene: Scene, k: int) -> Array:
    # Friction that is won over gradually: tanh of the last move, or of its speed, over a knee.
    share = _moves(scene, k)
    if rng.random() < 0.5 and not scene.arm.slides.any():  # metres and radians share no longest
        share = share_of_longest(scene.session.moves, k)
    return np.tanh(share / rng.uniform(0.03, 0.15))


def _saturated_lag(rng: Rng, scene: Scene, k: int) -> Array:
    # No more after moves longer than a usual one.
    moves = _moves(scene, k)
    usual = float(np.median(np.abs(moves[moves != 0.0]))) * float(rng.uniform(0.8, 1.5))
    return -np.tanh(moves / usual)


def _wheel(rng: Rng, scene: Scene, k: int) -> Array:
    q = scene.session.q[:, k]
    return eccentric(q, _phase(rng), float(rng.uniform(0.1, 0.7)), _phase(rng))


def _joint(signal: Signal, effect: str, *others: str) -> Formula:
    return lambda rng, scene, k: _at_joint(scene, k, signal(rng, scene, k), effect, *others)


_PLAY = ("backlash", "friction_windup")
hysteresis = _joint(_hysteresis, *_PLAY)
dead_band = _joint(
    lambda rng, s, k: play_with_dead_band(_moves(s, k), float(rng.uniform(0.03, 0.2))), *_PLAY
)
sides = _joint(lambda rng, s, k: float(rng.choice([-1.0, 1.0])) * s.session.approach[:, k], *_PLAY)
wheel = _joint(_wheel, "transmission_harmonic")
lag = _joint(lambda _, s, k: -_moves(s, k), "settling")
saturated_lag = _joint(_saturated_lag, "settling")


def fading_ripple(rng: Rng, scene: Scene, k: int) -> Cause:
    """Twice a turn of the wave generator; the amplitude varies by a third about once a turn."""
    q, cycles = scene.session.q[:, k], 2.0 * scene.ratios[scene.arm.names[k]]
    dq = (1.0 + 0.33 * np.sin(q + _phase(rng))) * np.sin(cycles * q + _phase(rng))
    return _at_joint(scene, k, dq, "gear_ripple", values={"cycles": cycles})


def spring(rng: Rng, scene: Scene, k: int) -> Cause:
    """A drive that hardens. Raises Unsuitable where nothing turns the joint."""
    where, share = scene.arm.names[k], float(rng.uniform(0.0, 0.45))
    if where in scene.modelled or not scene.arm.joints[k].compliance:
        raise Unsuitable
    act = lambda s, at: turned(s, where, 1e-6 * hardening(at.torque[:, k], share))  # noqa: E731
    return Cause("joint_compliance", where, {}, act=act)


def two_masses(rng: Rng, scene: Scene, k: int) -> Cause:
    """Two masses that warm at a pace of their own, of a joint or beneath the base."""
    t = scene.clock
    short, long = rng.uniform(6.0, 12.0) * _MINUTE, rng.uniform(25.0, 50.0) * _MINUTE
    share = float(rng.uniform(0.3, 0.6))
    left = np.asarray(share * np.exp(-t / short) + (1.0 - share) * np.exp(-t / long))
    at_joint = rng.random() < 0.5
    return _at_joint(scene, k, left, "warm_up") if at_joint else _at_base(rng, left, "warm_up")


def foundation(rng: Rng, scene: Scene, k: int) -> Cause:
    """A floor that comes to rest ever more slowly."""
    left = np.exp(-((scene.clock / (rng.uniform(15.0, 40.0) * _MINUTE)) ** 0.6))
    return _at_base(rng, left, "warm_up")


def oblique(rng: Rng, scene: Scene, k: int) -> Cause:
    """The base turns about an axis that is neither upright nor level and passes beside it."""
    axis = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.35, 1.0, 3)
    axis /= np.linalg.norm(axis)
    twist = np.concatenate([np.cross(rng.uniform(-0.6, 0.6, 3), axis), axis])
    left = np.exp(-scene.clock / (rng.uniform(12.0, 45.0) * _MINUTE))
    return _at_base(rng, left, "warm_up", twist=twist)


def drift(rng: Rng, scene: Scene, k: int) -> Cause:
    """The base moves on evenly."""
    return _at_base(rng, scene.session.hours, "base_drift", "tracker_drift")


def slow_step(rng: Rng, scene: Scene, k: int) -> Cause:
    """A jump that takes a minute or two."""
    t = scene.clock
    at, width = float(rng.uniform(0.15, 0.85) * t[-1]), rng.uniform(0.5, 2.0) * _MINUTE
    jump = np.asarray(0.5 * (1.0 + np.tanh((t - at) / width)))
    if rng.random() < 0.5:
        return _at_joint(scene, k, jump, "step", values={"at": at})
    return _at_base(rng, jump, "step", values={"at": at})


def slow_heat(rng: Rng, scene: Scene, k: int) -> Cause:
    """Links that follow the air by twenty minutes, and grow by 1 um/(m K) at size one."""
    degrees = lagging(scene.session.temperature, scene.session.time, _LAG) - 20.0
    return Cause("thermal_expansion", "arm", {}, act=lambda s, _: grown(s, 1e-6 * degrees))


FORMULAS: tuple[Formula, ...] = (
    hysteresis, dead_band, wheel, fading_ripple, lag, saturated_lag, spring, two_masses, foundation,
    oblique, drift, slow_step, slow_heat,
)  # fmt: skip
"""Of which a single cause is one."""
WHOLE: tuple[Formula, ...] = (sides, fading_ripple, wheel)
"""Those that all joints of an arm may have alike."""


def one_of(kinds: tuple[Formula, ...], rng: Rng, scene: Scene) -> Cause:
    """A formula and a joint that turns, by chance."""
    kind = kinds[int(rng.integers(len(kinds)))]
    joints = [k for k, joint in enumerate(scene.arm.joints) if not joint.slides]
    return kind(rng, scene, int(rng.choice(joints)))
