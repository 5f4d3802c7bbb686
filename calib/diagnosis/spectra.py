"""The residual along each joint's axis over cycles a turn, and the lines in it.

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

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.stage import Fit, Stage
from calib.effects.drive import along_axis
from calib.effects.gear_ripple import FEWEST, GearRipple
from calib.identification.scan import carried, falls, times
from calib.linear import Complement
from calib.poses import Poses
from calib.threads import one_blas_thread

_FEWEST, _MOST = 0.25, 450.0  # cycles a turn
_STEP = 0.25  # of a line's width
_CHANCE = 0.01  # of a false alarm, over all joints and cycles
_MOST_LINES = 8  # of a joint
_ROUNDS = 4  # of a fit of lines, from where the scan found them
_ALIKE = 0.9  # correlation over the poses from which on two lines are one
_PERHAPS = 0.7  # of their phases alone, worth an exact look
_SLOW = 3.0  # cycles a turn below which what stands out is no line
_NONE = np.zeros(0)


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
    joints = _joints(stage, fit, scale)
    tried = sum(len(joint.cycles) for joint in joints)
    alarm = -2.0 * float(np.log(_CHANCE / max(tried, 1)))
    return tuple(joint.spectrum(alarm) for joint in joints)


def _joints(stage: Stage, fit: Fit, scale: float) -> list[_Joint]:
    """Every joint that turns and moves, with what its spectrum needs."""
    robot, poses, kept = fit.model.robot, stage.data.poses, ~stage.dropped
    moving = [
        GearRipple(robot.joints[k], k + 1, along_axis(robot, k)[:, None], FEWEST, 1, None)
        for k in range(robot.dof)
        if not robot.prismatic[k] and len(np.unique(poses.q[kept, k])) > 2
    ]
    if not moving:
        return []
    carriers = [ripple.carrier for ripple in moving]
    whole, values = fit.model.extended(fit.values, carriers)
    _, J = whole.jacobian(values, poses)
    rows = fit.observation.rows(J[..., -len(carriers) :])
    found = []
    for i, ripple in enumerate(moving):
        own = [
            effect
            for effect in fit.model.effects
            if isinstance(effect, GearRipple) and effect.where == ripple.where
        ]
        bare = fit.without(own) if own else fit
        parts = [fit.values[fit.positions(effect)] for effect in own]
        named = tuple((values[0], values[1:3]) for values in parts)
        complement = bare.linear.complement
        found.append(_Joint(ripple, poses, complement, rows[..., i : i + 1], scale, named))
    return found


@dataclass(frozen=True, eq=False)
class _Joint:
    """One joint.

    beside : Complement, of what is modelled without its ripples
    carrier : ndarray, shape (m, R, 1), whitened; named : cycles and amounts (2,) of its ripples
    """

    ripple: GearRipple
    poses: Poses
    complement: Complement
    carrier: Array
    scale: float
    named: tuple[tuple[float, Array], ...]

    @cached_property
    def width(self) -> float:
        return self.ripple.width(self.poses)

    @cached_property
    def cycles(self) -> Array:
        return np.arange(_FEWEST, _MOST, _STEP * self.width)

    @property
    def q(self) -> Array:
        return self.poses.q[:, self.ripple.frame - 1]

    def spectrum(self, alarm: float) -> Spectrum:
        fall = self.falls(self.complement, self.cycles)
        return Spectrum(
            joint=self.ripple.where,
            cycles=self.cycles,
            fall=fall,
            false_alarm=alarm,
            width=self.width,
            repeats=self.repeats(),
            lines=self.lines(fall, alarm),
            named=tuple((float(c), self.aliases(c, a)) for c, a in self.named if a.any()),
        )

    def falls(self, complement: Complement, cycles: Array) -> Array:
        """Fall at some cycles (C,), in variances of the noise."""
        limits = (self.ripple.allowance or 1.0) * np.array(
            [p.limit for p in self.ripple.amplitudes]
        )
        scan, functions = (
            carried(complement, self.carrier),
            self.ripple.functions(self.poses, cycles),
        )
        return falls(scan, functions, limits) / self.scale**2

    def lines(self, fall: Array, alarm: float) -> tuple[SpectralLine, ...]:
        """Lines above the alarm, the strongest first; looked for about what is half as high."""
        slow = self.cycles < _SLOW
        joint = self.beside_slow() if fall[slow].max(initial=0.0) > alarm else self
        near, complement = self.about(self.cycles[fall > 0.5 * alarm]), joint.complement
        at, found = np.zeros(0), list[float]()
        while len(near) and len(found) < _MOST_LINES:
            now = joint.falls(complement, near)
            best = int(np.argmax(now))
            if now[best] <= alarm:
                break
            fitted = joint.fitted(np.append(at, near[best]))
            at, complement = fitted.at, joint.complement.without(fitted.X)
            found.append(float(now[best]))
            near = self.about(near[now > 0.5 * alarm], but=at)
        return tuple(joint.line(k, fitted, fall) for k, fall in enumerate(found))

    def about(self, chosen: Array, but: Array = _NONE) -> Array:
        """Cycles within a line's width of those chosen, but none of a line and nothing slow."""
        cycles = self.cycles[self.cycles >= FEWEST]
        near, taken = (
            (np.abs(cycles[:, None] - some) <= self.width).any(axis=1) for some in (chosen, but)
        )
        return np.asarray(cycles[near & ~taken])

    def beside_slow(self) -> _Joint:
        """The joint with everything below three cycles a turn projected out as well."""
        cycles = np.arange(_FEWEST, _SLOW, 0.5 * self.width)
        functions = self.ripple.functions(self.poses, cycles).transpose(1, 0, 2)
        rows = times(self.carrier, functions.reshape(len(self.q), -1))
        return replace(self, complement=self.complement.without(self.complement.columns(rows)))

    def line(self, k: int, fitted: _Fitted, fall: float) -> SpectralLine:
        amounts, part = fitted.amounts[k], slice(3 * k, 3 * k + 3)
        own = self.scale**2 * fitted.covariance[part, part]
        towards = amounts / np.hypot(*amounts)
        return SpectralLine(
            cycles=float(fitted.at[k]),
            std=float(np.sqrt(own[2, 2])),
            amplitude=float(np.hypot(*amounts)),
            amplitude_std=float(np.sqrt(towards @ own[:2, :2] @ towards)),
            fall=fall,
            aliases=self.aliases(float(fitted.at[k]), amounts),
        )

    def fitted(self, at: Array) -> _Fitted:
        """Lines (L,) together, from where they were found: Gauss-Newton."""
        amounts = np.zeros((len(at), 2))
        for _ in range(_ROUNDS):
            X = self.columns(at, amounts)
            length = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
            found = np.linalg.lstsq(X / length, self.complement.left, rcond=1e-6)[0] / length
            found = found.reshape(-1, 3)
            amounts = found[:, :2]
            at = at + np.clip(found[:, 2], -_STEP * self.width, _STEP * self.width)
        return _Fitted(at, amounts, self.columns(at, amounts))

    def columns(self, at: Array, amounts: Array) -> Array:
        """Derivatives by cosine, sine and cycles of each line, beside the model, (N, 3 L)."""
        F, slopes = (f(self.poses, at) for f in (self.ripple.functions, self.ripple.slopes))
        by_cycles = np.einsum("lmf,lf->lm", slopes, amounts)[..., None]
        functions = np.concatenate([F, by_cycles], axis=-1).transpose(1, 0, 2)
        return self.complement.columns(times(self.carrier, functions.reshape(len(self.q), -1)))

    def aliases(self, cycles: float, amounts: Array) -> tuple[float, ...]:
        """Cycles at which a line would explain nearly all of this one at the poses measured."""
        peaks = self.alike(cycles)
        if not len(peaks):
            return ()
        own = self.columns(np.array([cycles]), amounts[None])[:, :2] @ amounts
        alone = replace(self.complement, left=own)
        near = peaks[:, None] + _STEP * self.width * np.linspace(-0.5, 0.5, 9)
        share = self.falls(alone, near.ravel()).reshape(near.shape) * self.scale**2 / (own @ own)
        best = np.argmax(share, axis=1)
        alias = share.max(axis=1) > _ALIKE**2
        return tuple(float(c) for c in near[np.arange(len(near)), best][alias])

    def alike(self, cycles: float) -> Array:
        """Peaks of the correlation of phases with a line elsewhere, whatever else is modelled."""
        apart = np.abs(self.cycles - cycles)
        worth = np.maximum(self.window(apart), self.window(self.cycles + cycles))
        worth = np.where(apart > self.width, worth, 0.0)
        padded = np.pad(worth, 1)
        peak = (worth >= padded[:-2]) & (worth > padded[2:]) & (worth > _PERHAPS)
        return np.asarray(self.cycles[peak])

    def window(self, cycles: Array) -> Array:
        """``|mean exp(i c q)|`` over the poses by what they say of the joint, shape (C,)."""
        return np.interp(cycles, *self.windows)

    @cached_property
    def windows(self) -> tuple[Array, Array]:
        """Cycles in equal steps up to twice the most, and the window there, both (K,)."""
        step, energy = 0.5 * _STEP * self.width, (self.carrier**2).sum(axis=(1, 2))
        count = int(np.ceil(np.sqrt(2.0 * _MOST / step))) + 1
        # Of exp(i (a + b) q) the sum over poses is a product of two matrices.
        fine = np.exp(1j * np.outer(np.arange(count) * step, self.q))
        coarse = np.exp(1j * np.outer(np.arange(count) * (count * step), self.q))
        cycles = np.linspace(0.0, (count**2 - 1) * step, count**2)
        worth: Array = np.abs((coarse * energy) @ fine.T).ravel() / (float(energy.sum()) or 1.0)
        return cycles, worth

    def repeats(self) -> float | None:
        """Cycles after which all poses are in step again, the first peak that is high enough."""
        cycles, worth = self.windows
        peak = (worth[1:-1] >= worth[:-2]) & (worth[1:-1] > worth[2:]) & (worth[1:-1] > _ALIKE)
        again = np.flatnonzero(peak & (cycles[1:-1] > self.width)) + 1
        if not len(again):
            return None
        k = again[0]
        low, middle, high = worth[k - 1 : k + 2]
        shift = 0.5 * (low - high) / (low - 2.0 * middle + high)
        return float(cycles[k] + shift * (cycles[1] - cycles[0]))


@dataclass(frozen=True, eq=False)
class _Fitted:
    """L lines fitted together.

    at : ndarray, shape (L,), cycles; amounts : ndarray, shape (L, 2)
    X : ndarray, shape (N, 3 L), derivatives by cosine, sine and cycles, line by line
    """

    at: Array
    amounts: Array
    X: Array

    @cached_property
    def covariance(self) -> Array:
        """Of amounts and cycles, line by line, shape (3 L, 3 L), the noise of variance one."""
        length = np.maximum(np.linalg.norm(self.X, axis=0), 1e-300)
        X = self.X / length
        return np.asarray(np.linalg.pinv(X.T @ X, hermitian=True) / np.outer(length, length))
