"""How large errors of a kind are in this robot: widths of a normal prior, from its own readings.

Every elementary error j, one of six constants at a frame or a parameter of another effect, is taken as
``N(0, w_c^2 / u_g)``: w_c is the width of its class (kind and unit), u_g says how much less the place g
errs than others of its kind; a worn joint errs more. With X the columns, V the covariance of the
readings, n its scale and D the covariance of the errors,

    -2 log L = log|n^2 V| + log|D| + log|X^T V^-1 X / n^2 + D^-1| + y^T P y

(Patterson and Thompson, Biometrika 58(3), 1971). What is known beforehand stands beside it, each as an
inverse gamma law: ``w_c^2`` about the plausible size of the kind, n about one, and ``1 / u_g`` about
one, so that a place far beyond its kind is met (a multivariate t). The maximum is found by expectation
and maximisation (Dempster, Laird and Rubin, J. R. Stat. Soc. B 39(1), 1977). That climbs and crosses no
valley, and an error of a hundred plausible sizes has one before it: so each class begins with the most
likely of a few widths.

The constants of a model are an irreducible set, each a sum of elementary ones; base and markers, which
stand anywhere, take up the rest.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from calib.arrays import Array, IntArray

_KNOWN = 0.5  # errors of a kind that its plausible size stands for
_TAIL = 1.0  # degrees of freedom of what a place errs more or less than others
_STATED = 20.0  # numbers that the noise, as estimated without any prior, stands for
_MOST_ROUNDS = 100
_SETTLED = 0.01  # of a width
_BEGUN = 10.0 ** np.arange(0.0, 4.5, 0.5)  # plausible sizes that a width may begin with
_SAVED = 0.25  # parameters: where the prior determines fewer, it makes no difference that counts

Key: TypeAlias = tuple[str, str, str]
"""Effect, where and name of a parameter."""


@dataclass(frozen=True, eq=False)
class SizePrior:
    """Parameters of a robot; base, tool and markers are never among them.

    keys : tuple of Key; covariance : ndarray, shape (k, k), SI
    """

    keys: tuple[Key, ...]
    covariance: Array

    def only(self, keys: Collection[Key]) -> SizePrior:
        """The marginal prior of some parameters."""
        own = np.array([i for i, key in enumerate(self.keys) if key in keys], dtype=int)
        return SizePrior(tuple(self.keys[i] for i in own), self.covariance[np.ix_(own, own)])

    @property
    def std(self) -> Array:
        """Standard deviations, shape (k,), SI."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def whitening(self) -> Array:
        """W (k, k) with ``W covariance W^T = I``."""
        half = np.linalg.cholesky(self.covariance / np.outer(self.std, self.std))
        return np.asarray(np.linalg.inv(half) / self.std)

    def positions(self, keys: Collection[Key]) -> IntArray:
        """Where its parameters stand among some keys, shape (k,); all of them must be there."""
        order = {key: i for i, key in enumerate(keys)}
        return np.array([order[key] for key in self.keys], dtype=int)


@dataclass(frozen=True, eq=False)
class Elementary:
    """The e elementary errors that k parameters of a model stand for.

    keys : tuple of Key, of the parameters; at : ndarray of int, shape (k,), where they stand
    G : ndarray, shape (k, e), parameters from elementary errors
    sizes : ndarray, shape (e,), SI, plausible ones
    classes : tuple of (kind, unit); scales : ndarray, shape (c,), SI per unit
    of_class, of_place : ndarray of int, shape (e,)
    """

    keys: tuple[Key, ...]
    at: IntArray
    G: Array
    sizes: Array
    classes: tuple[tuple[str, str], ...]
    scales: Array
    of_class: IntArray
    of_place: IntArray

    def without(self, removed: Collection[int]) -> Elementary:
        """The errors behind all but the parameters at some positions."""
        kept = np.flatnonzero(~np.isin(self.at, list(removed)))
        shown = self.G[kept].any(axis=0)
        left, of_class = np.unique(self.of_class[shown], return_inverse=True)
        return replace(
            self,
            keys=tuple(self.keys[i] for i in kept),
            at=self.at[kept],
            G=self.G[np.ix_(kept, shown)],
            sizes=self.sizes[shown],
            classes=tuple(self.classes[c] for c in left),
            scales=self.scales[left],
            of_class=of_class.reshape(-1),
            of_place=np.unique(self.of_place[shown], return_inverse=True)[1].reshape(-1),
        )

    def prior(self, variances: Array) -> SizePrior:
        """What is believed of the parameters, for variances (e,) of the elementary errors."""
        cov = (self.G * variances) @ self.G.T
        return SizePrior(self.keys, (cov + cov.T) / 2.0)


@dataclass(frozen=True, eq=False)
class Widths:
    """How large errors are.

    widths : ndarray, shape (c,), SI, of the classes; variances : ndarray, shape (e,), SI, of the errors
    noise : float, actual over assumed noise of the rows; prior : SizePrior, of the parameters
    saved : float, how many parameters it determines in place of the readings
    """

    of: Elementary
    widths: Array
    variances: Array
    noise: float
    prior: SizePrior
    saved: float

    @property
    def shows(self) -> bool:
        """Whether the readings leave so much open that the prior makes a difference."""
        return self.saved > _SAVED


def widths_of(of: Elementary, J: Array, y: Array, dof: int) -> Widths:
    """Estimate the widths.

    J : ndarray, shape (N, k), derivatives by the parameters in independent rows of unit variance, all
        else projected out; y : ndarray, shape (N,), readings less those of the nominal arm, likewise
    dof : int, rows that count less what was projected out
    """
    rows = _NormalEquations(of, J.T @ J, J.T @ y, float(y @ y), dof)
    widths, share, noise = rows.begun(), np.ones(len(of.sizes)), 1.0
    in_class, in_place = np.bincount(of.of_class), np.bincount(of.of_place)
    for _ in range(_MOST_ROUNDS):
        squares, noise = rows.expected(widths[of.of_class] ** 2 / share, noise)
        scaled = np.bincount(of.of_place, squares / widths[of.of_class] ** 2)
        share = ((_TAIL + in_place) / (_TAIL + scaled))[of.of_place]
        total = np.bincount(of.of_class, share * squares) + _KNOWN * rows.typical**2
        last, widths = widths, np.sqrt(total / (in_class + _KNOWN))
        if np.allclose(widths, last, rtol=_SETTLED):
            break
    variances = widths[of.of_class] ** 2 / share
    prior = of.prior(variances)
    return Widths(of, widths, variances, noise, prior, rows.saved(prior, noise))


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Normal equations ``A v = g`` of the parameters, ``square`` that of their right-hand side."""

    of: Elementary
    A: Array
    g: Array
    square: float
    dof: int

    @cached_property
    def typical(self) -> Array:
        """Plausible size of each class, shape (c,)."""
        squares = np.bincount(self.of.of_class, self.of.sizes**2)
        return np.asarray(np.sqrt(squares / np.bincount(self.of.of_class)))

    def begun(self) -> Array:
        """The most likely of a few widths, shape (c,): of all classes alike, then of each in turn."""
        widths = min(np.outer(_BEGUN, self.typical), key=self._value)
        for c, size in enumerate(self.typical):
            tried = np.tile(widths, (len(_BEGUN), 1))
            tried[:, c] = _BEGUN * size
            widths = min(tried, key=self._value)
        return np.asarray(widths)

    def _value(self, widths: Array) -> float:
        """-2 log likelihood of widths (c,) at the stated noise, with what is known of them."""
        D = (self.of.G * widths[self.of.of_class] ** 2) @ self.of.G.T
        both = np.eye(len(self.g)) + self.A @ D
        value = np.linalg.slogdet(both)[1] - self.g @ D @ np.linalg.solve(both, self.g)
        known = (self.typical / widths) ** 2 - np.log((self.typical / widths) ** 2)
        return float(value + _KNOWN * known.sum())

    def expected(self, variances: Array, noise: float) -> tuple[Array, float]:
        """Expected squares (e,) of the errors at some variances (e,), and the noise that is left."""
        G = self.of.G
        W = np.linalg.solve((G * variances) @ G.T, G)
        m, C = self._posterior(self.of.prior(variances), noise)
        mean = variances * (W.T @ m)
        taken = (G * W).sum(axis=0) - (W * (C @ W)).sum(axis=0)
        squares = mean**2 + np.maximum(variances - variances**2 * taken, 0.0)
        left = self.square - 2.0 * float(m @ self.g) + float(m @ self.A @ m)
        left += float((self.A * C).sum())
        return squares, float(np.sqrt((max(left, 0.0) + _STATED) / (self.dof + _STATED)))

    def _posterior(self, prior: SizePrior, noise: float) -> tuple[Array, Array]:
        """Values (k,) and their covariance (k, k)."""
        W = prior.whitening
        C = np.linalg.inv(self.A / noise**2 + W.T @ W)
        return C @ self.g / noise**2, np.asarray(C, dtype=np.float64)

    def saved(self, prior: SizePrior, noise: float) -> float:
        """How many of the k parameters the prior determines, not the readings."""
        _, C = self._posterior(prior, noise)
        return len(self.g) - float((self.A * C).sum()) / noise**2
