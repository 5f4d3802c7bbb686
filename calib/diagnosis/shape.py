"""Whether a named effect has the right shape: its size should not vary from reading to reading.

A cause whose place and variable are right, but not its form, leaves a residual that is the effect
itself times some function of what else is known of the reading. So what the fitted effect does is
multiplied by functions of each such variable, two harmonics of an angle, a straight line and a parabola
of anything else, each with a root mean square of about one; the score test asks whether any of it is
there.

A wrong shape is off by a part of itself: the coefficients of its modulation are a priori normal
(:func:`calib.inference.evidence.weighted_test`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray, Mask
from calib.diagnosis.stage import Fit, Stage
from calib.effects.joint import along_axis
from calib.effects.protocol import Effect
from calib.identification.noise import refuted
from calib.inference.evidence import f_tail, score_test, weighted_test
from calib.observations.linear import Complement, orthonormal
from calib.poses import Measurements, Poses

_STILL = 1e-6  # scatter, over size, of what does not vary
_OWN, _OTHERS, _KNOWN = 0.6, 0.15, 0.25
"""Shares of the chance of a false doubt: most errors of form run with the joint's own angle."""


@dataclass(frozen=True, eq=False)
class Modulation:
    """A few functions of a variable.

    depends_on : str, as in the results
    centred : ndarray, shape (m, k), about the mean: by what the size would vary
    plain : ndarray, shape (m, c), zero where the variable is: what the whole effect may run with
        instead; of an angle, which has no zero, none
    chance : float, share of the chance of a false doubt
    """

    depends_on: str
    centred: Array
    plain: Array
    chance: float


def modulations(stage: Stage, fit: Fit, where: str) -> list[Modulation]:
    """Functions of every known variable by which the size of an effect may vary."""
    kept = ~stage.dropped
    found = list(_postures(fit.model.robot, stage.data.poses, kept, where))
    known = [
        (name, varying)
        for name, columns in _known(stage.data, fit, where)
        if (varying := [c for c in columns if _varies(c[kept])])
    ]
    for name, columns in known:
        powers = [c**n for c in columns for n in (1, 2)]
        # Of mean zero and a root mean square of one over the readings that count.
        centred = [(p - p[kept].mean()) / p[kept].std() for p in powers if _varies(p[kept])]
        plain = np.column_stack([c / np.abs(c[kept]).max() for c in columns])
        found.append(Modulation(name, np.column_stack(centred), plain, _KNOWN / len(known)))
    return found


def _postures(robot: Robot, poses: Poses, kept: Mask, where: str) -> Iterator[Modulation]:
    """Harmonics of once and twice each angle; of a slide, over its travel."""
    for k, joint in enumerate(robot.joints):
        if _varies(poses.q[kept, k]):
            run = waves(robot, poses.q, poses.q[kept], k)
            yield Modulation(
                f"q:{joint}", run, np.zeros((len(run), 0)), chance_of(robot, joint, where)
            )


def waves(robot: Robot, q: Array, over: Array, joint: int) -> Array:
    """Harmonics of a joint, of a slide those of its travel ``over`` some poses, shape (m, 4)."""
    angle = q[:, joint]
    if robot.prismatic[joint]:
        travel = over[:, joint]
        angle = np.pi * (angle - travel.mean()) / float(np.ptp(travel))
    return np.asarray(
        np.sqrt(2.0) * np.column_stack([f(n * angle) for n in (1, 2) for f in (np.cos, np.sin)])
    )


def chance_of(robot: Robot, joint: str, where: str) -> float:
    """Share of the chance of a false doubt that an effect at a place runs with the joint's angle."""
    if where in robot.joints:
        return _OWN if joint == where else _OTHERS / (robot.dof - 1)
    return (_OWN + _OTHERS) / robot.dof


def _known(data: Measurements, fit: Fit, where: str) -> Iterator[tuple[str, Sequence[Array]]]:
    """What else is known of each reading: its name in the results, and columns of shape (m,)."""
    poses, robot = data.poses, fit.model.robot
    if poses.clocked:
        yield "time", [poses.clock]
    if poses.temperature is not None:
        yield "temperature", [poses.warming]
    loads = [np.linalg.norm(poses.wrench[:, :3], axis=-1)]
    if where in robot.joints:
        k = robot.joints.index(where)
        torque = fit.model.state(fit.values, poses).wrench.local[:, k + 1] @ along_axis(robot, k)
        loads.append(torque)
        if poses.motion is not None:
            longest = np.maximum(poses.motion.max(axis=1), _STILL)
            yield f"motion:{where}", [poses.motion[:, k], poses.motion[:, k] / longest]
        if poses.approach is not None:
            yield f"approach:{where}", [poses.approach[:, k]]
    yield "load", loads
    count = np.maximum(data.seen.sum(axis=1), 1)
    yield "range", [(np.linalg.norm(data.points, axis=-1) * data.seen).sum(axis=1) / count]


def _varies(column: Array) -> bool:
    return bool(np.ptp(column) > _STILL * max(1.0, float(np.abs(column).max())))


SHAPE_ALPHA = 0.03
"""Probability of doubting a right shape."""
_PART = 0.25  # of the effect's size, by which each function is expected to modulate a wrong one
_SURE = 0.01  # probability by chance below which an effect is there beside what doubts it


@dataclass(frozen=True)
class Doubt:
    """The strongest evidence that the size of an effect varies with something.

    p : float, probability of as much by chance; depends_on : str, with what its size varies most
    fall : float, of the sum of squares
    also_there : bool, whether the effect is needed beside what its size varies with
    """

    p: float
    depends_on: str
    fall: float
    also_there: bool

    @property
    def stands(self) -> bool:
        """Whether the shape is to be doubted."""
        return self.p < SHAPE_ALPHA


@dataclass(frozen=True, eq=False)
class ShapeQuestion:
    """Columns of all modulations of an effect, beside everything that is modelled.

    asked : tuple of Modulation; X : ndarray, shape (N, K), columns of one after the other
    rest : Complement, of everything that is modelled
    """

    asked: tuple[Modulation, ...]
    X: Array
    rest: Complement

    @cached_property
    def _products(self) -> tuple[Array, Array, Array]:
        """``S``, ``z`` and lengths of the columns, in the noise as the residual shows it."""
        left, noise = self.rest.of(self.X), np.sqrt(_variance(self.rest))
        lengths = np.linalg.norm(self.X, axis=0) / noise
        return left.T @ left / noise**2, left.T @ self.rest.left / noise**2, lengths

    def tested(self, number: int) -> tuple[float, float]:
        """p and fall of one modulation."""
        (S, z, lengths), own = self._products, self._columns[number]
        prior = _PART**2 * np.eye(len(own))
        return weighted_test(S[np.ix_(own, own)], z[own], lengths[own], prior)

    @property
    def answer(self) -> tuple[Modulation, float, float]:
        """The modulation that speaks most against the effect, its p over all asked, and its fall."""
        tests = [self.tested(k) for k in range(len(self.asked))]
        counted = [p / m.chance for (p, _), m in zip(tests, self.asked, strict=True)]
        first = int(np.argmin(counted))
        return self.asked[first], min(1.0, counted[first]), tests[first][1]

    @property
    def _columns(self) -> list[IntArray]:
        counts = [m.centred.shape[1] for m in self.asked]
        return np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])


def shape_doubt(stage: Stage, fit: Fit, effect: Effect, causes: int = 1) -> Doubt:
    """The strongest doubt.

    causes : int, among which the chance of a false one is shared
    """
    asked = question(stage, fit, effect)
    if asked is None:
        return Doubt(1.0, "none", 0.0, True)
    first, p, fall = asked.answer
    p = min(1.0, causes * p)
    also_there = p >= SHAPE_ALPHA or _also_there(stage, fit, effect, first)
    return Doubt(p, first.depends_on, fall, also_there)


def question(stage: Stage, fit: Fit, effect: Effect) -> ShapeQuestion | None:
    """All modulations of an effect in a fit; None where nothing varies with which it could."""
    asked = tuple(modulations(stage, fit, effect.where))
    if not asked:
        return None
    X = _times(stage, fit, effect, np.column_stack([m.centred for m in asked]))
    return ShapeQuestion(asked, X, fit.linear.complement)


def _also_there(stage: Stage, fit: Fit, effect: Effect, doubted: Modulation) -> bool:
    """Whether the effect pays beside itself running wholly with the variable."""
    if not doubted.plain.shape[1]:
        return True
    own, rest = fit.positions(effect), fit.without([effect]).linear
    instead, (r, J) = _times(stage, fit, effect, doubted.plain), rest.independent
    alone = rest.beside(orthonormal(np.concatenate([J @ rest.span, instead], axis=1)), r)
    X, lengths = alone.of(J[:, own]), np.linalg.norm(J[:, own], axis=0)
    fall, k = score_test(X.T @ X, X.T @ alone.left, np.asarray(lengths))
    return f_tail(float(fall) / _variance(alone) / max(int(k), 1), max(int(k), 1), np.inf) < _SURE


def _variance(rest: Complement) -> float:
    """Actual over stated variance of the noise where the residual contradicts that, else one."""
    cost, freedom = float(rest.left @ rest.left), rest.rows - rest.Q.shape[1]
    return cost / freedom if refuted(cost, freedom) else 1.0


def _times(stage: Stage, fit: Fit, effect: Effect, functions: Array) -> Array:
    """Whitened rows of what an effect does times functions (m, k) of the reading, shape (N, k)."""
    own = fit.positions(effect)
    _, J = fit.model.jacobian(fit.values, stage.data.poses)
    moved = (J[..., own] @ fit.moving[own])[..., None] * functions[:, None, None, :]
    return fit.linear.columns(fit.observation.rows(moved))
