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
from calib.errors import CalibError
from calib.identification.identification import Identification
from calib.inference.coverage import Interval, freedom, lengths
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
    noise : ndarray, shape (k, k), SI, of both days; later : what the later day does not know
    half : ndarray, shape (n, k), of unit variance and blind to what a day left open
    dof : float, degrees of freedom behind the noise
    """

    keys: tuple[Key, ...]
    apart: tuple[str, ...]
    change: Array
    std: Array
    noise: Array
    later: Array
    half: Array
    dof: float

    @property
    def whitened(self) -> Array:
        """The difference in independent rows of unit variance, shape (n,)."""
        return np.asarray(self.half @ self.change)

    @property
    def p_value(self) -> float:
        """Probability of so large a difference where nothing changed."""
        from scipy.special import chdtrc, fdtrc

        rows, statistic = len(self.whitened), float(self.whitened @ self.whitened)
        if not rows:
            return 1.0
        known = self.dof > 1e8
        return float(chdtrc(rows, statistic) if known else fdtrc(rows, self.dof, statistic / rows))

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
    alone = sorted("{}:{}.{}".format(*k) for k in {*before.keys} ^ {*after.keys} if lasting(k))
    if alone:
        raise CalibError(f"one result lacks {', '.join(alone)}; identify both with one [model]")
    apart = _apart(before, after)
    of_the_day = [k for k in after.keys if k in before.keys and f"{k[0]}:{k[1]}" not in apart]
    keys = tuple(k for k in of_the_day if k[0] in _PLACES or lasting(k))
    if not any(map(lasting, keys)):
        raise CalibError("the results have no parameter of the robot in common")
    days = (before, after)
    rows = [[day.keys.index(key) for key in keys] for day in days]
    opened = [  # how the values follow what was not determined, of plausible size
        day.covariance[own][:, day.lost] / np.sqrt(np.diag(day.covariance)[day.lost])
        for day, own in zip(days, rows, strict=True)
    ]
    known = [day.covariance[np.ix_(own, own)] for day, own in zip(days, rows, strict=True)]
    then, now = (C - V @ V.T for C, V in zip(known, opened, strict=True))  # by the noise alone
    change = after.values[rows[1]] - before.values[rows[0]]
    for i, (effect, where, name) in enumerate(keys):
        marker = where.removeprefix("marker:")
        if effect == "tool" and marker in after.markers:  # guesses may differ
            change[i] = (after.markers[marker] - before.markers[marker])["xyz".index(name)]
    lost = [[key for key, out in zip(day.keys, day.lost, strict=True) if out] for day in days]
    every = list(dict.fromkeys([*lost[0], *lost[1]]))
    unseen = np.zeros((len(keys), len(every)))
    unseen[:, [every.index(key) for key in lost[1]]] += opened[1]
    unseen[:, [every.index(key) for key in lost[0]]] -= opened[0]

    noise, variance = then + now, np.maximum(np.diag(then + now), 0.0)
    scale = np.where(variance > 0.0, np.sqrt(variance), 1.0)
    shares = [own / np.outer(scale, scale) for own in (noise, then, now)]
    roots, axes = np.linalg.eigh(shares[0])
    seen = roots > _NUMERICAL * roots.max()
    W = (axes[:, seen] / np.sqrt(roots[seen])).T / scale
    U, felt, _ = np.linalg.svd(W @ unseen, full_matrices=True)
    std = np.where((unseen**2).sum(axis=1) < _FELT**2 * variance, np.sqrt(variance), np.nan)
    # Degrees of freedom by Welch and Satterthwaite, by the share that each day has of the sum.
    inverse = np.linalg.pinv(shares[0], rcond=_NUMERICAL, hermitian=True)
    share = np.array([np.trace(inverse @ own) for own in shares[1:]])
    dof = 1.0 / max(((share / share.sum()) ** 2 / (before.dof, after.dof)).sum(), 1e-12)
    half = U[:, (felt > _FELT).sum() :].T @ W
    return Difference(keys, apart, change, std, noise, known[1], half, float(dof))


def lasting(key: Key) -> bool:
    """Whether a parameter is the robot's own, of an effect that is known here."""
    return bool(getattr(catalogue().get(key[0]), "lasting", False))


def _apart(before: DayEstimate, after: DayEstimate) -> tuple[str, ...]:
    """Bases and markers of both results that stand elsewhere."""
    then, now = (dict(zip(day.keys, day.values, strict=True)) for day in (before, after))
    bases = [key for key in now if key[0] == "base" and key in then]
    far = [f"base:{key[1]}" for key in bases if abs(now[key] - then[key]) > _SAME_PLACE]
    for name in after.markers:
        moved = after.markers[name] - before.markers.get(name, after.markers[name])
        far += [f"tool:marker:{name}"] * bool(np.abs(moved).max() > _SAME_PLACE)
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
    wider = found.dof / (found.dof - 2.0) if found.dof > 3.0 else 3.0  # variance of Student's t
    targets, weights = targets_of(cell)
    targets = replace(targets, start=estimate.start)
    follows, back = _rows(estimate, found.keys, targets, weights), found.noise @ found.half.T
    expected = ExpectedError(estimate, targets)
    rest = weights / weights.sum() @ (expected.arm**2 + expected.model**2)
    there, _ = errors_at(follows, back @ found.whitened, back @ back.T * wider, weights)
    rms, worst = errors_at(follows, found.change, found.later * wider, weights)
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
