"""Expanded uncertainty: coverage factors from degrees of freedom (JCGM 100, annex G; JCGM 102).

A combined variance ``sum v_i`` has ``(sum v_i)^2 / sum(v_i^2 / nu_i)`` degrees of freedom (Welch and
Satterthwaite). What covers 95 % of the lengths of an error in space depends on how many components
share its variance: with the covariance C of the error, its squared length is ``tr C`` times a
chi-square over its own ``n = (tr C)^2 / tr(C^2)`` degrees (Satterthwaite again, one for an error along
a line, three for one alike in all directions), and over an F where the variance has nu degrees of
freedom itself. For n of one this is Student's t.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from calib.arrays import Array

LEVEL = 0.95
"""Probability that every interval covers, unless it says otherwise."""
_KNOWN = 1e9  # degrees of freedom of what counts as known
_TAIL = (1.0 - LEVEL) / 2.0
_HALVINGS = 60


class Interval(NamedTuple):
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float

    def combined(self, other: float) -> Interval:
        """Of an error, together with an independent one of this size."""
        return Interval(*(float(np.hypot(own, other)) for own in self))


def effective_freedom(parts: Iterable[tuple[ArrayLike, float]]) -> Array:
    """Degrees of freedom of a sum of variances, infinite where all are as good as known, or zero.

    parts : variances, of any one shape, each with its degrees of freedom

    >>> float(effective_freedom([(4.0, 8.0), (1.0, np.inf)]))  # 25 / (16 / 8)
    12.5
    """
    total, lost = np.zeros(()), np.zeros(())
    for variance, freedom in parts:
        total = total + np.asarray(variance)
        lost = lost + np.asarray(variance) ** 2 / freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(lost > total**2 / _KNOWN, total**2 / lost, np.inf)


def coverage_factor(freedom: ArrayLike, spread: ArrayLike = 1.0, level: float = LEVEL) -> Array:
    """By what a standard uncertainty is multiplied so as to cover errors with a probability.

    freedom : degrees of freedom of the variance, one at least; spread : n of the module's docstring

    >>> [round(float(coverage_factor(nu)), 2) for nu in (1.0, 10.0, np.inf)]
    [12.71, 2.23, 1.96]
    """
    from scipy.special import fdtri

    nu = np.clip(freedom, 1.0, _KNOWN)
    return np.asarray(np.sqrt(fdtri(spread, nu, level)))


def directions(spread: Array) -> Array:
    """How many directions share the variance of errors, n of the module's docstring, shape (...).

    spread : ndarray, shape (..., R, k), whose covariance is ``spread spread^T``; 1 where that is zero
    """
    inner = np.swapaxes(spread, -1, -2) @ spread
    if spread.shape[-2] < spread.shape[-1]:
        inner = spread @ np.swapaxes(spread, -1, -2)
    total, squares = np.trace(inner, axis1=-2, axis2=-1), (inner**2).sum(axis=(-1, -2))
    return np.asarray(np.where(total > 0.0, total**2 / np.where(squares > 0.0, squares, 1.0), 1.0))


WHOLE = 6
"""Numbers that the readings of one stay give of a pose that errs as a whole."""


def freedom(
    noise: float, stays: int, rank: float, *, as_a_whole: bool, numbers: int = WHOLE
) -> float:
    """Degrees of freedom behind a covariance, one at least.

    noise : of the noise level, infinite where it is known
    stays : how often the arm came to a pose whose readings count; rank : parameters that were fitted
    as_a_whole : whether poses err as a whole by what these readings show: then stays count, not points,
        less those that the parameters took up
    numbers : that a parameter may be taken from at one stay; fewer are more cautious

    >>> freedom(120.0, 25, 30, as_a_whole=False), freedom(120.0, 25, 30, as_a_whole=True)
    (120.0, 20.0)
    """
    return max(1.0, stays - rank / numbers if as_a_whole else float(noise))


def lengths(moved: Array, spread: Array) -> Array:
    """Value, low and high, shape (m, 3), of lengths estimated as moved (m, R).

    spread : ndarray, shape (m, R, k), covariance ``spread spread^T``

    A squared length ``d' Q d`` of an estimate ``d ~ N(delta, C)`` exceeds ``delta' Q delta`` by
    ``tr(Q C)`` in the mean, which is taken off. Its interval inverts the distribution, a gamma one of
    the same mean ``tr(Q C) + s`` and variance ``2 tr(Q C Q C) + 4 delta' Q C Q delta`` (Satterthwaite,
    Biometrics Bull. 2, 1946), in s. From above a length counts as no smaller than noise alone makes it
    in the mean: one that is smaller by luck would say that nothing can hide (Cowan et al.,
    arXiv:1105.3166).
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
