"""What a difference does at the targets, in metres, with intervals; and whether a tolerance holds.

A squared length ``d' Q d`` of an estimate ``d ~ N(delta, C)`` exceeds ``delta' Q delta`` by ``tr(Q C)``
in the mean, which is taken off. Its interval inverts the distribution, a gamma one of the same mean
``tr(Q C) + s`` and variance ``2 tr(Q C Q C) + 4 delta' Q C Q delta`` (Satterthwaite, Biometrics Bull.
2, 1946), in s.
"""

from __future__ import annotations

from collections.abc import Iterable
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

    rms, worst : Length; errors : tuple of Length, at each target; worst_at : int, its position
    """

    rms: Length
    worst: Length
    errors: tuple[Length, ...]
    worst_at: int


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
    roots, axes = np.linalg.eigh(_symmetric(cov))
    half = axes * np.sqrt(np.maximum(roots, 0.0))
    moved, spread = rows @ change, rows @ half
    share = np.sqrt(weights / weights.sum())
    whole = _length((share[:, None] * moved).ravel(),
                    (share[:, None, None] * spread).reshape(-1, spread.shape[-1]))  # fmt: skip
    errors = tuple(_length(own, its) for own, its in zip(moved, spread, strict=True))
    counted = [i for i in np.flatnonzero(weights > 0.0).tolist()]
    at = max(counted, key=lambda i: errors[i].value)
    worst = Length(
        errors[at].value,
        max(errors[i].low for i in counted),
        max(errors[i].high for i in counted),
    )
    return AtTargets(whole, worst, errors, at)


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2.0)


def _length(moved: Array, spread: Array) -> Length:
    """Length of what was estimated as moved (R,), with covariance ``spread spread^T``."""
    total = float(moved @ moved)
    gram = spread.T @ spread
    noise, noise2 = float(np.trace(gram)), float((gram**2).sum())
    if noise <= 0.0:
        return Length(*3 * [float(np.sqrt(total))])
    along = float(((spread.T @ moved) ** 2).sum()) / total if total > 0.0 else 0.0
    along = max(along, noise2 / noise)
    low, high = (_solved(total, noise, noise2, along, tail) for tail in (1.0 - _TAIL, _TAIL))
    return Length(float(np.sqrt(max(total - noise, 0.0))), float(np.sqrt(low)), float(np.sqrt(high)))


def _solved(total: float, noise: float, noise2: float, along: float, level: float) -> float:
    """The s at which a square below the one found has a probability, zero where none is so small."""
    from scipy.special import gammainc

    def below(s: float) -> float:
        mean, variance = noise + s, 2.0 * noise2 + 4.0 * along * s
        return float(gammainc(mean**2 / variance, total * mean / variance))

    if below(0.0) <= level:
        return 0.0
    low, high = 0.0, max(total, noise)
    while below(high) > level:
        high *= 2.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if below(middle) > level else (low, middle)
    return high


def verdict(error: Length, tolerance: float) -> Verdict:
    """Whether an error is within a tolerance, by its whole interval (decision rule of ISO 14253-1)."""
    if error.high <= tolerance:
        return "holds"
    return "does_not" if error.low > tolerance else "cannot_be_said"


def largest(lengths: Iterable[Length]) -> float:
    """The largest upper limit, m."""
    return max(length.high for length in lengths)
