"""What a difference does at the targets, in metres, with intervals; and whether a tolerance holds.

A squared length ``d' Q d`` of an estimate ``d ~ N(delta, C)`` exceeds ``delta' Q delta`` by ``tr(Q C)``
in the mean, which is taken off. Its interval inverts the distribution, a gamma one of the same mean
``tr(Q C) + s`` and variance ``2 tr(Q C Q C) + 4 delta' Q C Q delta`` (Satterthwaite, Biometrics Bull.
2, 1946), in s. From above a difference counts as no smaller than noise alone makes it in the mean: one
that is smaller by luck would say that nothing can hide (Cowan et al., arXiv:1105.3166).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arrays import Array
from calib.change.difference import Difference
from calib.model import Model
from calib.model.covariance import working_points
from calib.poses import Poses

Verdict = Literal["holds", "does_not", "cannot_be_said"]
_TAIL = 0.025
_HALVINGS = 60


@dataclass(frozen=True)
class Length:
    """An error with its 95 % interval, m."""

    value: float
    low: float
    high: float

    def beside(self, other: float) -> Length:
        """Together with an independent error, m."""
        return Length(*(float(np.hypot(own, other)) for own in (self.value, self.low, self.high)))


@dataclass(frozen=True, eq=False)
class AtTargets:
    """Errors over the m targets.

    rms, worst : Length; worst_at : int, position of the target that errs most
    errors : ndarray, shape (m, 3), m, of each: value, low, high
    """

    rms: Length
    worst: Length
    worst_at: int
    errors: Array


def rows_at(
    model: Model, values: Array, targets: Poses, found: Difference, weights: Array
) -> Array:
    """How the error at each target follows the difference, shape (m, 3 M, k), RMS over M points.

    Bases and markers that are not compared are placed anew, so as to fit the targets best.
    """
    model = working_points(model)
    _, J = model.jacobian(values, targets)
    J = J.reshape(len(targets), -1, J.shape[-1]) / np.sqrt(len(model.markers))
    keys = [(p.effect, p.where, p.name) for p in model.parameters]
    own = J[..., [keys.index(key) for key in found.keys]]
    free = [i for i, key in enumerate(keys) if key[0] in ("base", "tool") and key not in found.keys]
    placed = J[..., free]
    placed = placed[..., np.abs(placed).max(axis=(0, 1)) > 0.0] if len(free) else placed
    if not placed.shape[-1]:
        return np.asarray(own)
    root = np.sqrt(weights)[:, None, None]
    flat = (root * placed).reshape(-1, placed.shape[-1])
    fit = np.linalg.lstsq(flat, (root * own).reshape(-1, own.shape[-1]), rcond=1e-9)[0]
    return np.asarray(own - placed @ fit)


def at_targets(rows: Array, change: Array, cov: Array, weights: Array) -> AtTargets:
    """Errors of a difference (k,) with its covariance (k, k).

    rows : ndarray, shape (m, R, k), of :func:`rows_at`; weights : ndarray, shape (m,)
    The worst target is that of the largest estimate; above it stands the largest upper limit of any.
    """
    roots, axes = np.linalg.eigh((cov + cov.T) / 2.0)
    half = axes * np.sqrt(np.maximum(roots, 0.0))
    moved, spread = rows @ change, rows @ half
    share = np.sqrt(weights / weights.sum())
    all_moved, all_spread = share[:, None] * moved, share[:, None, None] * spread
    whole = lengths(all_moved.reshape(1, -1), all_spread.reshape(1, -1, len(half)))[0]
    errors = lengths(moved, spread)
    counted = np.flatnonzero(weights > 0.0)
    at = int(counted[np.argmax(errors[counted, 0])])
    worst = Length(float(errors[at, 0]), *errors[counted, 1:].max(axis=0).tolist())
    return AtTargets(Length(*whole.tolist()), worst, at, errors)


def lengths(moved: Array, spread: Array) -> Array:
    """Value, low and high, shape (m, 3), of lengths estimated as moved (m, R).

    spread : ndarray, shape (m, R, k), covariance ``spread spread^T``
    """
    total = (moved**2).sum(axis=1)
    noise = (spread**2).sum(axis=(1, 2))
    small = spread.shape[1] <= spread.shape[2]
    turned = np.swapaxes(spread, 1, 2)
    noise2 = ((spread @ turned if small else turned @ spread) ** 2).sum(axis=(1, 2))
    sure = noise <= 0.0
    noise, noise2 = np.where(sure, 1.0, noise), np.where(sure, 1.0, noise2)
    along = ((turned @ moved[..., None]) ** 2).sum(axis=(1, 2)) / np.where(total > 0.0, total, 1.0)
    along = np.maximum(along, noise2 / noise)
    low = _solved(total, noise, noise2, along, 1.0 - _TAIL)
    high = _solved(np.maximum(total, noise), noise, noise2, along, _TAIL)
    squared = np.column_stack([np.maximum(total - noise, 0.0), low, high])
    return np.asarray(np.sqrt(np.where(sure[:, None], total[:, None], squared)))


def _solved(total: Array, noise: Array, noise2: Array, along: Array, level: float) -> Array:
    """The s at which a square below the one found has a probability, zero where none is so small."""
    from scipy.special import gammainc

    def below(s: Array) -> Array:
        mean, variance = noise + s, 2.0 * noise2 + 4.0 * along * s
        return np.asarray(gammainc(mean**2 / variance, total * mean / variance))

    low, high = np.zeros_like(total), np.maximum(total, noise)
    while (short := below(high) > level).any():
        high = np.where(short, 2.0 * high, high)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        more = below(middle) > level
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return np.where(below(np.zeros_like(total)) <= level, 0.0, high)


def verdict(error: Length, tolerance: float) -> Verdict:
    """Whether an error is within a tolerance, by its whole interval (decision rule of ISO 14253-1)."""
    if error.high <= tolerance:
        return "holds"
    return "does_not" if error.low > tolerance else "cannot_be_said"
