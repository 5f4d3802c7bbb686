"""Lines of the residual along each joint's axis over cycles a turn.

At every number of cycles c stands by how much ``dq = a cos(c q) + b sin(c q)`` would lower the sum of
squares beside everything else modelled (:mod:`calib.identification.scan`), in units of the noise:
chi-square of two degrees of freedom where there is no line. The joint's own ripples are taken out of
the model, so that those already found show again; other joints keep theirs, which else would leak.

Lines are found one after the other, each beside those before it, and fitted together: a strong line
shows by chance correlations all over a spectrum. So does what is slow, below three cycles a turn; where
it stands out, lines are looked for beside it. Below fifteen no gear is meant. Where a joint stands in
equal steps s, c and ``|c - k 2 pi / s|`` are one and the same at these poses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.stage import Fit, Stage
from calib.effects.joint import along_axis
from calib.effects.ripple import FEWEST, GearRipple
from calib.identification.scan import carried, falls, times
from calib.observations.linear import Complement, unit
from calib.poses import Poses
from calib.threads import one_blas_thread

_FEWEST, _MOST = 0.25, 450.0  # cycles a turn
_STEP = 0.25  # of a line's width
_CHANCE = 0.01  # of a false alarm, over all joints and cycles
_MOST_LINES = 8  # of a joint
_ROUNDS = 8  # of a fit of lines, from where the scan found them
_ALIKE = 0.9  # correlation over the poses from which on two lines are one
_SLOW = 3.0  # cycles a turn below which what stands out is no line


@dataclass(frozen=True)
class SpectralLine:
    """A line above the false alarm.

    cycles, std : float, 1/turn; amplitude, amplitude_std : float, rad; fall : float, when it was found
    aliases : tuple of float, other cycles that these poses cannot tell from it
    """

    cycles: float
    std: float
    amplitude: float
    amplitude_std: float
    fall: float
    aliases: tuple[float, ...]

    @property
    def ratios(self) -> tuple[float, float]:
        """Gear ratios that it would mean: of an error twice a turn of the fast side, and once."""
        return 0.5 * self.cycles, self.cycles


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The residual along one joint's axis.

    cycles, fall : ndarray, shape (C,), 1/turn and variances of the noise
    false_alarm : float, fall that chance exceeds once in a hundred, over all joints and cycles
    width : float, of a line, 1/turn; repeats : float or None, cycles after which nothing new comes,
        where the joint stands in equal steps
    named : tuple of (cycles, aliases), of the joint's ripples in the model
    """

    joint: str
    cycles: Array
    fall: Array
    false_alarm: float
    width: float
    repeats: float | None
    lines: tuple[SpectralLine, ...]
    named: tuple[tuple[float, tuple[float, ...]], ...]


@one_blas_thread
def spectra(result: Diagnosis) -> tuple[Spectrum, ...]:
    """The spectrum of every joint that turns and moves, beside all that a diagnosis found."""
    return spectra_of(result.stage, result.after, result.scale)


def spectra_of(stage: Stage, fit: Fit, scale: float = 1.0) -> tuple[Spectrum, ...]:
    """The same at any fit; scale : float, actual over the standard deviation that it weighs by."""
    joints = list(_joints(stage, fit, scale))
    tried = sum(len(joint.cycles) for joint in joints)
    alarm = -2.0 * float(np.log(_CHANCE / max(tried, 1)))
    return tuple(joint.spectrum(alarm) for joint in joints)


def _joints(stage: Stage, fit: Fit, scale: float) -> Iterator[_Joint]:
    """Every joint that turns and moves."""
    robot, poses, kept = fit.model.robot, stage.data.poses, ~stage.dropped
    moving = [
        GearRipple(robot.joints[k], k + 1, along_axis(robot, k)[:, None], FEWEST, 1, None)
        for k in range(robot.dof)
        if not robot.prismatic[k] and len(np.unique(poses.q[kept, k])) > 2
    ]
    whole, values = fit.model.extended(fit.values, [ripple.carrier for ripple in moving])
    rows = fit.observation.rows(whole.jacobian(values, poses)[1][..., len(fit.values) :])
    for i, ripple in enumerate(moving):
        effects = [e for e in fit.model.effects if isinstance(e, GearRipple)]
        own = [effect for effect in effects if effect.where == ripple.where]
        beside = (fit.without(own) if own else fit).linear.complement
        named = tuple(fit.values[fit.positions(effect)][:3] for effect in own)
        yield _Joint(ripple, poses, beside, rows[..., i : i + 1], scale, named)


@dataclass(frozen=True, eq=False)
class _Joint:
    """One joint.

    beside : Complement, of what is modelled without its ripples
    carrier : ndarray, shape (m, R, 1), whitened
    named : tuple of ndarray, shape (3,), cycles and amounts of its ripples
    """

    ripple: GearRipple
    poses: Poses
    beside: Complement
    carrier: Array
    scale: float
    named: tuple[Array, ...]

    @cached_property
    def width(self) -> float:
        return self.ripple.width(self.poses)

    @cached_property
    def cycles(self) -> Array:
        return np.arange(_FEWEST, _MOST, _STEP * self.width)

    def spectrum(self, alarm: float) -> Spectrum:
        fall = self.falls(self.beside, self.cycles)
        slow = fall[self.cycles < _SLOW].max(initial=0.0) > alarm
        lines = (self.without_slow() if slow else self).lines(fall, alarm)
        named = tuple(
            (float(own[0]), self.aliases(own[0], own[1:])) for own in self.named if own[1:].any()
        )
        return Spectrum(
            self.ripple.where,
            self.cycles,
            fall,
            alarm,
            self.width,
            self.repeats(),
            tuple(lines),
            named,
        )

    def falls(self, beside: Complement, cycles: Array) -> Array:
        """Fall at some cycles (C,), in variances of the noise."""
        limits = np.array([p.limit for p in self.ripple.amplitudes]) * (
            self.ripple.allowance or 1.0
        )
        functions = self.ripple.functions(self.poses, cycles)
        return falls(carried(beside, self.carrier), functions, limits) / self.scale**2

    def columns(self, functions: Array) -> Array:
        """What functions (L, m, f) of the pose move, beside the model, shape (N, L f)."""
        by_pose = np.moveaxis(functions, 0, 1).reshape(len(self.poses), -1)
        return self.beside.columns(times(self.carrier, by_pose))

    def without_slow(self) -> _Joint:
        """The joint with everything below three cycles a turn projected out as well."""
        slow = np.arange(_FEWEST, _SLOW, 0.5 * self.width)
        columns = self.columns(self.ripple.functions(self.poses, slow))
        return replace(self, beside=self.beside.without(columns))

    def lines(self, fall: Array, alarm: float) -> Iterator[SpectralLine]:
        """Lines above the alarm, the strongest first; looked for about what is half as high."""
        at, found = np.zeros(0), list[float]()
        amounts, X = np.zeros((0, 2)), np.zeros((len(self.beside.left), 0))
        near = self.about(self.cycles[fall > 0.5 * alarm], at)
        while len(near) and len(found) < _MOST_LINES:
            beside = self.beside.without(X) if found else self.beside
            now = self.falls(beside, near)
            best = int(np.argmax(now))
            if now[best] <= alarm:
                break
            at, amounts, X = self.fitted(np.append(at, near[best]))
            found.append(float(now[best]))
            near = self.about(near[now > 0.5 * alarm], at)
        length = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        inverse = np.linalg.pinv(unit(X).T @ unit(X), hermitian=True)
        cov = self.scale**2 * inverse / np.outer(length, length)
        for k, strength in enumerate(found):
            own, size = cov[3 * k : 3 * k + 3, 3 * k : 3 * k + 3], float(np.hypot(*amounts[k]))
            along = amounts[k] / size
            std, spread = float(np.sqrt(own[2, 2])), float(np.sqrt(along @ own[:2, :2] @ along))
            aliases = self.aliases(at[k], amounts[k])
            yield SpectralLine(float(at[k]), std, size, spread, strength, aliases)

    def about(self, chosen: Array, lines: Array) -> Array:
        """Cycles within a line's width of those chosen, but none of the lines and nothing slow."""
        cycles = self.cycles[self.cycles >= FEWEST]
        near, taken = (
            (np.abs(cycles[:, None] - some) <= self.width).any(axis=1) for some in (chosen, lines)
        )
        return np.asarray(cycles[near & ~taken])

    def fitted(self, at: Array) -> tuple[Array, Array, Array]:
        """Lines (L,) fitted together from where they were found, by Gauss-Newton steps.

        Cycles (L,), amounts (L, 2), and derivatives (N, 3 L) by cosine, sine and cycles, line by line.
        """
        amounts = np.zeros((len(at), 2))
        for _ in range(_ROUNDS):
            X = self._derivatives(at, amounts)
            length = np.linalg.norm(X, axis=0)
            length[length == 0.0] = 1.0  # cycles that no amount shows yet
            step = np.linalg.lstsq(X / length, self.beside.left, rcond=1e-6)[0] / length
            amounts, moved = np.split(step.reshape(-1, 3), [2], axis=1)
            at = at + np.clip(moved[:, 0], -_STEP * self.width, _STEP * self.width)
        return at, amounts, self._derivatives(at, amounts)

    def _derivatives(self, at: Array, amounts: Array) -> Array:
        F, slopes = (f(self.poses, at) for f in (self.ripple.functions, self.ripple.slopes))
        return self.columns(np.concatenate([F, slopes @ amounts[..., None]], axis=-1))

    def aliases(self, cycles: float, amounts: Array) -> tuple[float, ...]:
        """Cycles at which a line would explain nearly all of this one at the poses measured."""
        own = self.columns(self.ripple.functions(self.poses, np.array([cycles]))) @ amounts
        explained = self.falls(replace(self.beside, left=own), self.cycles) * self.scale**2
        peaks = _peaks(self.cycles, explained / (own @ own), _ALIKE**2)
        return tuple(peaks[np.abs(peaks - cycles) > self.width].tolist())

    def repeats(self) -> float | None:
        """Cycles after which all poses are in step again: ``|mean exp(i c q)|`` is nearly one."""
        step, energy = 0.5 * _STEP * self.width, (self.carrier**2).sum(axis=(1, 2))
        q, count = self.poses.q[:, self.ripple.frame - 1], int(np.sqrt(_MOST / step)) + 1
        # Of exp(i (a + b) q) the sum over poses is a product of two matrices.
        fine = np.exp(1j * np.outer(np.arange(count) * step, q))
        coarse = np.exp(1j * np.outer(np.arange(count) * count * step, q))
        in_step = np.abs((coarse * energy) @ fine.T).ravel() / (float(energy.sum()) or 1.0)
        peaks = _peaks(step * np.arange(float(count**2)), in_step, _ALIKE)
        return next((float(c) for c in peaks if c > self.width), None)


def _peaks(cycles: Array, height: Array, least: float) -> Array:
    """Where a function in equal steps (C,) has peaks above a least height, by parabolas."""
    low, middle, high = height[:-2], height[1:-1], height[2:]
    at = np.flatnonzero((middle >= low) & (middle > high) & (middle > least))
    low, middle, high = low[at], middle[at], high[at]
    shift = 0.5 * (low - high) / (low - 2.0 * middle + high)
    return np.asarray(cycles[at + 1] + shift * (cycles[1] - cycles[0]))
