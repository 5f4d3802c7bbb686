"""The difference of two results of one robot, what it does at the targets, and whether one still holds.

A base or a marker is compared where it stands within 20 mm and 20 mrad of where it stood, else it is an
unknown of the day. What a day left open stood at nominal, and least squares put part of it into the
others: ``d = e + (V_after - V_before) u``, u the true errors. Rows that see u are taken out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from calib.arrays import Array, Mask, stacked
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.effects import catalogue
from calib.effects.readings import PartEffect, ReadingEffect
from calib.effects.timed import DriftingEffect
from calib.effects.tool_base import Base, Tool
from calib.effects.tuned import Tuned
from calib.errors import CalibError
from calib.identification.identification import Identification
from calib.inference.coverage import Interval, effective_freedom, freedom, lengths
from calib.inference.evidence import f_tail
from calib.inference.widths import Key
from calib.model.covariance import working_points
from calib.poses import Poses
from calib.prediction.estimate import Estimate, ExpectedError, estimate_of

FALSE_ALARM = 0.02
"""How often anything is said to have changed where nothing has."""
COORDINATES = 3
"""Of a pose that errs as a whole, for the degrees of freedom of a day: fewer than it gives."""
_SAME_PLACE = 0.02  # m and rad
_PLACES = ("base", "tool")
_OF_A_DAY = (Base, Tool, DriftingEffect, ReadingEffect, PartEffect, Tuned)
"""Effects whose values are of one day: places, what drifts, how an instrument reads, tunings."""
_FELT = 0.1  # standard deviations: what an open parameter of plausible size may shift a row by
_NUMERICAL = 1e-10  # of the largest eigenvalue of a correlation matrix


@dataclass(frozen=True, eq=False)
class DayEstimate:
    """The estimate of one day.

    keys : tuple of Key; values : ndarray, shape (p,), SI; covariance : ndarray, shape (p, p), SI, with
        what was not determined at plausible sizes; lost : ndarray of bool, shape (p,), what that is
    markers : dict, name -> ndarray, shape (3,), m, tip frame
    dof : float, degrees of freedom behind the covariance, infinite where the noise was known
    """

    keys: tuple[Key, ...]
    values: Array
    covariance: Array
    lost: Mask
    markers: Mapping[str, Array]
    dof: float

    @property
    def open_keys(self) -> list[Key]:
        """What was not determined."""
        return [key for key, out in zip(self.keys, self.lost, strict=True) if out]

    @cached_property
    def known(self) -> dict[Key, float]:
        """Every value, SI; of a marker where it is in the tip frame, for guesses may differ."""
        known = dict(zip(self.keys, self.values.tolist(), strict=True))
        for name, at in self.markers.items():
            known |= {
                ("tool", f"marker:{name}", axis): x for axis, x in zip("xyz", at, strict=True)
            }
        return known

    def by_noise(self, keys: Sequence[Key], lost: Sequence[Key]) -> tuple[Array, Array]:
        """Covariance (k, k) by the noise alone, and how values follow what was not determined, (k, l).

        lost : of this day and others, each of plausible size
        """
        own = [self.keys.index(key) for key in keys]
        opened = self.covariance[own][:, self.lost] / np.sqrt(np.diag(self.covariance)[self.lost])
        placed = np.zeros((len(keys), len(lost)))
        placed[:, [lost.index(key) for key in self.open_keys]] = opened
        return self.covariance[np.ix_(own, own)] - opened @ opened.T, placed


def known_of(found: Identification) -> DayEstimate:
    """The estimate of one day from its identification."""
    estimate, keys, poses = estimate_of(found), found.model.keys, int((~found.fit.outlier).sum())
    scatters = estimate.variances is not None and estimate.variances.any
    markers = dict(zip(found.model.marker_names, found.marker_positions, strict=True))
    dof = freedom(found.noise.dof, poses, len(keys), as_a_whole=scatters, numbers=COORDINATES)
    lost = np.array([p.id in estimate.undetermined for p in found.model.parameters])
    return DayEstimate(keys, found.values, estimate.covariance, lost, markers, dof)


@dataclass(frozen=True, eq=False)
class Difference:
    """After minus before.

    keys : tuple of Key, the k parameters that are compared
    apart : tuple of str, bases and markers that stand elsewhere, ``base:..`` or ``tool:marker:..``
    change : ndarray, shape (k,), SI; std : ndarray, shape (k,), NaN where a day does not determine it
    noise : ndarray, shape (k, k), SI, of both days
    half : ndarray, shape (n, k), of unit variance and blind to what a day left open
    dof : float, degrees of freedom behind the noise
    """

    keys: tuple[Key, ...]
    apart: tuple[str, ...]
    change: Array
    std: Array
    noise: Array
    half: Array
    dof: float

    @property
    def whitened(self) -> Array:
        """The difference in independent rows of unit variance, shape (n,)."""
        return np.asarray(self.half @ self.change)

    @property
    def p_value(self) -> float:
        """Probability of so large a difference where nothing changed."""
        rows = len(self.whitened)
        return f_tail(float((self.whitened**2).mean()), rows, self.dof) if rows else 1.0

    @cached_property
    def family_p(self) -> Array:
        """P value of each parameter, (k,), by Holm's step-down (Scand. J. Statist. 6, 1979)."""
        from scipy.special import stdtr

        p = 2.0 * stdtr(min(self.dof, 1e9), -np.abs(self.change) / self.std)
        order = np.argsort(p)[: np.isfinite(p).sum()]
        stepped = np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1))
        p[order] = np.minimum(stepped, 1.0)
        return np.asarray(p)

    @property
    def moved(self) -> Mask:
        """Which parameters did, shape (k,), named only where something changed at all."""
        return np.asarray((self.p_value < FALSE_ALARM) & (self.family_p < FALSE_ALARM))


def difference(before: DayEstimate, after: DayEstimate) -> Difference:
    """What lies between two results. Raises CalibError: other models, or nothing in common."""
    apart = _apart(before, after)
    keys = _compared(before, after, apart)
    lost = tuple(dict.fromkeys([*before.open_keys, *after.open_keys]))
    (then, opened_then), (now, opened_now) = (day.by_noise(keys, lost) for day in (before, after))
    noise, unseen = then + now, opened_now - opened_then
    change = np.array([after.known[key] - before.known[key] for key in keys])
    variance = np.maximum(np.diag(noise), 0.0)
    scale = np.where(variance > 0.0, np.sqrt(variance), 1.0)
    roots, axes = np.linalg.eigh(noise / np.outer(scale, scale))
    shown = roots > _NUMERICAL * roots.max()
    W = (axes[:, shown] / np.sqrt(roots[shown])).T / scale
    U, felt, _ = np.linalg.svd(W @ unseen, full_matrices=True)
    std = np.where((unseen**2).sum(axis=1) < _FELT**2 * variance, np.sqrt(variance), np.nan)
    half = U[:, (felt > _FELT).sum() :].T @ W
    days = ((then, before.dof), (now, after.dof))
    dof = effective_freedom((np.trace(W @ own @ W.T), nu) for own, nu in days)
    return Difference(keys, apart, change, std, noise, half, float(dof))


def _compared(before: DayEstimate, after: DayEstimate, apart: tuple[str, ...]) -> tuple[Key, ...]:
    """Parameters that both days may share: the robot's own, and places that stand where they stood."""
    alone = sorted("{}:{}.{}".format(*k) for k in {*before.keys} ^ {*after.keys} if lasting(k))
    if alone:
        raise CalibError(f"one result lacks {', '.join(alone)}; identify both with one [model]")
    common = [k for k in after.keys if k in before.keys and f"{k[0]}:{k[1]}" not in apart]
    if not any(map(lasting, common)):
        raise CalibError("the results have no parameter of the robot in common")
    return tuple(k for k in common if k[0] in _PLACES or lasting(k))


def lasting(key: Key) -> bool:
    """Whether a parameter is the robot's own, of an effect that is known here."""
    effect = catalogue().get(key[0])
    return effect is not None and not issubclass(effect, _OF_A_DAY)


def _apart(before: DayEstimate, after: DayEstimate) -> tuple[str, ...]:
    """Bases and markers of both results that stand elsewhere."""
    then, now = before.known, after.known
    places = [key for key in now if key[0] in _PLACES and key in then]
    far = [f"{k[0]}:{k[1]}" for k in places if abs(now[k] - then[k]) > _SAME_PLACE]
    return tuple(dict.fromkeys(far))


class Changes(NamedTuple):
    """Result of :func:`changes`.

    there : Interval, m, RMS at the targets between both robots; its upper end is what may be unseen
    kept : tuple of Interval, m, RMS and worst error by the earlier values on the later robot
    """

    difference: Difference
    there: Interval
    kept: tuple[Interval, Interval]


def changes(cell: Cell, before: DayEstimate, after: DayEstimate, estimate: Estimate) -> Changes:
    """Compare two results of one robot; cell, estimate : of the later one. Raises CalibError."""
    if not estimate.converged:
        raise CalibError("the later result did not converge; mend the identification first")
    found = difference(before, after)
    wider = 1.0 / (1.0 - 2.0 / max(found.dof, 3.0))  # variance of Student's t
    targets, weights = targets_of(cell)
    targets = replace(targets, start=estimate.start)
    follows, back = _rows(estimate, found.keys, targets, weights), found.noise @ found.half.T
    expected = ExpectedError(estimate, targets)
    rest = weights / weights.sum() @ (expected.arm**2 + expected.model**2)
    there, _ = errors_at(follows, back @ found.whitened, back @ back.T * wider, weights)
    own = [after.keys.index(key) for key in found.keys]
    later = after.covariance[np.ix_(own, own)] * wider
    rms, worst = errors_at(follows, found.change, later, weights)
    return Changes(found, there, (rms.combined(rest**0.5), worst.combined(rest**0.5)))


def verdict(error: Interval, tolerance: float) -> Literal["holds", "does_not", "cannot_be_said"]:
    """Whether an error is within a tolerance, by its whole interval (decision rule of ISO 14253-1)."""
    if error.high <= tolerance:
        return "holds"
    return "does_not" if error.low > tolerance else "cannot_be_said"


def _rows(estimate: Estimate, keys: Sequence[Key], targets: Poses, weights: Array) -> Array:
    """How the error at each target follows parameters, shape (m, 3 M, k), RMS over M points.

    Other bases and markers are placed anew, so as to fit the targets best.
    """
    model = working_points(estimate.model)
    _, J = model.jacobian(estimate.values, targets)
    J = J.reshape(len(targets), -1, J.shape[-1]) / np.sqrt(len(model.markers))
    own = J[..., [model.keys.index(key) for key in keys]]
    free = [k[0] in _PLACES and k not in keys for k in model.keys]
    root = np.sqrt(weights)[:, None, None]
    flat, wanted = (stacked(root * columns) for columns in (J[..., free], own))
    return np.asarray(own - J[..., free] @ np.linalg.lstsq(flat, wanted, rcond=1e-9)[0])


def errors_at(rows: Array, change: Array, cov: Array, weights: Array) -> tuple[Interval, Interval]:
    """RMS, and the worst target: of the largest estimate, below the largest upper end of any."""
    roots, axes = np.linalg.eigh((cov + cov.T) / 2.0)
    half = axes * np.sqrt(np.maximum(roots, 0.0))
    moved, spread = rows @ change, rows @ half
    share = np.sqrt(weights / weights.sum())
    all_moved, all_spread = share[:, None] * moved, share[:, None, None] * spread
    whole = lengths(all_moved.reshape(1, -1), all_spread.reshape(1, -1, len(half)))[0]
    errors = lengths(moved, spread)
    counted = np.flatnonzero(weights > 0.0)
    return Interval(*whole.tolist()), Interval(*errors[counted].max(axis=0).tolist())
