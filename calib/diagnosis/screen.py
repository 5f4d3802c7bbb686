"""The score test: how much of what is left each candidate would explain.

With the whitened derivatives N of everything modelled and r the residual, a candidate with columns X is
judged by ``S = |U^T r|^2``, U an orthonormal basis of what is left of X once N is projected out. Where
nothing is missing S is chi-square with as many degrees of freedom as U has columns; an effect that is
there adds its noncentrality (Rao 1948; one QR of N serves all candidates).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import field as field_
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.evidence import (
    VISIBLE,
    along_prior,
    chance_above,
    cholesky_of,
    marginal_gain,
    ratio_above,
    score_test,
    visible_directions,
)
from calib.identification.noise_level import refuted
from calib.linear import orthonormal

CURVE_PRICE = float(2.0 * np.log(10.0))
"""What a curve must explain beyond a named cause, in -2 log likelihood: odds of ten to one."""
_AMPLITUDES = 24
_NOTHING = 1e-100  # sum of squares that is none


@dataclass(frozen=True, eq=False)
class Field:
    """Columns and residual with everything modelled projected out.

    columns : ndarray, shape (N, K), as they are; r : ndarray, shape (N,), in standard deviations
    lengths : ndarray, shape (K,), of the columns before any projection
    rows : int, that count; dof : int, degrees of freedom of r
    modelled : ndarray, shape (N, k), orthonormal, to be projected out of the columns; None where
        nothing is
    whole : Field or None, whose rows come before these
    Of the projected columns mostly products are asked, which need no projection: ``C^T C - H^T H``,
    H the columns in the directions of what is modelled.
    """

    columns: Array
    r: Array
    lengths: Array
    rows: int
    dof: int
    modelled: Array | None = None
    whole: Field | None = None
    _products: dict[bytes, tuple[Array, Array]] = field_(
        default_factory=dict, init=False, repr=False
    )

    @cached_property
    def X(self) -> Array:
        """The columns with everything modelled projected out, shape (N, K)."""
        return self.projected(np.arange(self.columns.shape[1]))

    @cached_property
    def modelled_part(self) -> Array:
        """The columns in the directions of what is modelled, shape (k, K)."""
        if self.modelled is None:
            return np.zeros((0, self.columns.shape[1]))
        return np.asarray(self.modelled.T @ self.columns)

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(self.r @ self.r) + (0.0 if self.whole is None else self.whole.cost)

    @cached_property
    def noise_refuted(self) -> bool:
        """Whether the residual's size contradicts the stated noise, in either direction."""
        return refuted(self.cost, self.dof)

    def evidence(self, fall: Array) -> Array:
        """Fall of -2 log likelihood by one of the sum of squares, shape (..), as of it.

        Where the residual refutes the stated noise, that is unknown.
        """
        if not self.noise_refuted:
            return fall
        left = np.log(np.maximum(self.cost - fall, _NOTHING))
        return np.asarray(self.dof * (np.log(max(self.cost, _NOTHING)) - left))

    @cached_property
    def spread(self) -> float:
        """Actual over stated variance where the residual refutes that, else one."""
        return self.cost / self.dof if self.noise_refuted else 1.0

    def products(self, columns: IntArray) -> tuple[Array, Array]:
        """``X^T X`` and ``X^T r`` of columns (..., k), shapes (..., k, k) and (..., k)."""
        *many, k = columns.shape
        sets = columns.reshape(int(np.prod(many)), k)
        keys = [own.tobytes() for own in sets]
        fresh = [i for i, key in enumerate(keys) if key not in self._products]
        if fresh:
            for i, S, z in zip(fresh, *self._multiplied(sets[fresh]), strict=True):
                self._products[keys[i]] = S, z
        found = [self._products[key] for key in keys]
        S, z = np.array([S for S, _ in found]), np.array([z for _, z in found])
        return S.reshape(*many, k, k), z.reshape(*many, k)

    def _multiplied(self, sets: IntArray) -> tuple[Array, Array]:
        """The products of n sets of columns (n, k)."""
        own = np.moveaxis(self.columns[:, sets], 0, 1)
        S, z = np.swapaxes(own, 1, 2) @ own, self.r @ own
        if self.modelled is not None:
            H = np.moveaxis(self.modelled_part[:, sets], 0, 1)
            S, z = S - np.swapaxes(H, 1, 2) @ H, z - (self.modelled.T @ self.r) @ H
        if self.whole is not None:
            S_whole, z_whole = self.whole.products(sets)
            S, z = S + S_whole, z + z_whole
        return S, z

    def crossed(self, these: IntArray, those: IntArray) -> Array:
        """``X^T X`` of some columns with others, shape (k, l)."""
        own = self.columns[:, these].T @ self.columns[:, those]
        if self.modelled is not None:
            own = own - self.modelled_part[:, these].T @ self.modelled_part[:, those]
        return own if self.whole is None else own + self.whole.crossed(these, those)

    def projected(self, columns: IntArray) -> Array:
        """Some columns with everything modelled projected out, shape (N, k)."""
        own = self.columns[:, columns]
        return (
            own if self.modelled is None else own - self.modelled @ self.modelled_part[:, columns]
        )

    def directions(self, columns: IntArray) -> Array:
        """``T``, shape (K, k), that makes columns (N, K) the orthonormal directions ``X T``."""
        T, seen = visible_directions(self.products(columns)[0], self.lengths[columns])
        return T[:, seen]


def field(N: Array, X: Array, r: Array, Q: Array | None = None) -> Field:
    """Project the modelled columns out of candidates and residual.

    N : ndarray, shape (rows, p), whitened derivatives of what is modelled; X : ndarray, shape (rows, K)
    r : ndarray, shape (rows,), whitened residuals; rows of zeros count nothing
    Q : ndarray, shape (rows, k), an orthonormal basis of what is modelled where it is known
    """
    Q = orthonormal(N) if Q is None else Q
    rows = int(np.count_nonzero(N.any(axis=1) | X.any(axis=1)))
    lengths = np.sqrt(np.einsum("nk,nk->k", X, X))
    return Field(X, r - Q @ (Q.T @ r), lengths, rows, rows - Q.shape[1], Q)


@dataclass(frozen=True)
class Score:
    """Result of the score test of one candidate.

    fall : float, by which the sum of squares would fall
    evidence : float, fall of -2 log likelihood; for a curve of the marginal one
    price : float, of its free directions (Schwarz 1978); a curve has paid for them in the evidence
    p : float, probability of as much by chance
    """

    fall: float
    evidence: float
    price: float
    p: float

    @property
    def gain(self) -> float:
        """Evidence less the price of the parameters (Schwarz)."""
        return self.evidence - self.price

    def counted(self, tried: float) -> Score:
        """The score of the best of so many."""
        if tried == 1:
            return self
        price = self.price + 2.0 * float(np.log(tried))
        return replace(self, price=price, p=min(1.0, self.p * max(tried, 1.0)))


NOTHING = Score(0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class ScoreRequest:
    """The columns of a candidate, and the prior under which they are scored.

    columns : ndarray of int, shape (k,)
    spread : ndarray, shape (k, k), covariance of a curve's coefficients a priori
    limits : ndarray, shape (k,), of a named cause's parameters, SI: one standard deviation a priori;
        any size without them
    eliminate : whether of a named cause's parameters only those count that pay
    """

    columns: IntArray
    spread: Array | None = None
    limits: Array | None = None
    eliminate: bool = False


def score(
    field: Field,
    columns: IntArray,
    spread: Array | None = None,
    limits: Array | None = None,
    eliminate: bool = False,
) -> Score:
    """Score of one candidate; arguments as of :class:`ScoreRequest`."""
    return scored(field, [ScoreRequest(columns, spread, limits, eliminate)])[0]


def scored(field: Field, asked: Sequence[ScoreRequest]) -> list[Score]:
    """Score of each candidate; those that have as many columns and are asked alike at once."""
    groups: dict[tuple[int, bool, bool], list[int]] = {}
    found = [NOTHING] * len(asked)
    for i, a in enumerate(asked):
        if a.spread is None and a.limits is not None and a.eliminate:
            found[i] = _eliminated(field, a.columns, a.limits)
        else:
            kind = len(a.columns), a.spread is not None, a.limits is not None
            groups.setdefault(kind, []).append(i)
    for members in groups.values():
        for i, own in zip(members, _alike(field, [asked[i] for i in members]), strict=True):
            found[i] = own
    return found


def _alike(field: Field, asked: Sequence[ScoreRequest]) -> list[Score]:
    """Scores of candidates that have as many columns and are asked alike."""
    columns = np.array([a.columns for a in asked])
    spread = [a.spread for a in asked if a.spread is not None]
    if spread:
        return _curves(field, columns, np.array(spread))
    limits = [a.limits for a in asked if a.limits is not None]
    return _named(field, columns, np.array(limits) if limits else None)


def _named(field: Field, columns: IntArray, limits: Array | None) -> list[Score]:
    """Score tests: chi-square where the noise is believed, F where the residual refutes it.

    columns : ndarray of int, shape (n, k); limits : ndarray, shape (n, k)
    """
    from scipy.special import chdtrc, fdtrc

    fall, k = score_test(*field.products(columns), field.lengths[columns], limits)
    left = field.dof - k
    evidence, p = fall, np.asarray(chdtrc(np.maximum(k, 1), fall))
    if field.noise_refuted:
        rest = np.maximum(field.cost - fall, _NOTHING)
        shown = left > 0
        evidence = np.where(shown, field.evidence(fall), fall)
        F = fall / np.maximum(k, 1) / (rest / np.maximum(left, 1))
        p = np.where(shown, fdtrc(np.maximum(k, 1), np.maximum(left, 1), F), p)
    table = np.column_stack([fall, evidence, k * np.log(max(field.rows, 1)), p]).tolist()
    return [Score(*row) if some else NOTHING for row, some in zip(table, k.tolist(), strict=True)]


def _eliminated(field: Field, columns: IntArray, limits: Array) -> Score:
    """Score of the parameters that pay, and for the choice of so many among all.

    With the largest believable sizes as a normal prior, taking one out again lets the sum of squares
    rise by its squared estimate over its variance.
    """
    from scipy.special import chdtrc, gammaln

    S, Xr = field.products(columns)
    cov = np.asarray(np.linalg.inv(S + np.diag(1.0 / limits**2)), dtype=np.float64)
    values, K = cov @ Xr, len(columns)
    spread = max(field.cost, _NOTHING) / field.dof if field.noise_refuted else 1.0
    each = float(np.log(max(field.rows, 1))) + 2.0 * float(np.log(2.0))
    gone, rise = backward_elimination(values, cov, each * spread)
    fall, k = float(Xr @ values) - rise, int(np.count_nonzero(~gone))
    if k == 0:
        return NOTHING
    choices = float(gammaln(K + 1) - gammaln(k + 1) - gammaln(K - k + 1))
    price = k * float(np.log(max(field.rows, 1))) + 2.0 * choices
    p = float(chdtrc(k, fall / spread)) * float(np.exp(min(choices, 700.0)))
    return Score(fall, float(field.evidence(np.array(fall))), price, min(1.0, p))


def backward_elimination(values: Array, cov: Array, price: float) -> tuple[Mask, float]:
    """Which parameters go, shape (k,) of bool, and by how much the sum of squares rises without them.

    values : ndarray, shape (k,), estimates; cov : ndarray, shape (k, k), their covariance
    price : float, rise of the sum of squares for which a parameter stays
    Taking one out lets it rise by the squared estimate over its variance; the others follow by their
    covariance. The one that is least worth goes first, as long as that costs less than its price.
    """
    gone, rise = np.zeros(len(values), dtype=bool), 0.0
    while not gone.all():
        variance = np.where(gone, 1.0, np.maximum(np.diag(cov), 1e-300))
        worth = np.where(gone, np.inf, values**2 / variance)
        i = int(np.argmin(worth))
        if float(worth[i]) >= price:
            break
        share = cov[:, i] / variance[i]
        values, cov = values - share * values[i], cov - np.outer(share, cov[i])
        gone[i], rise = True, rise + float(worth[i])
    return gone, rise


def _curves(field: Field, columns: IntArray, spread: Array) -> list[Score]:
    """Marginal likelihood of normal coefficients, at the amplitude that the data prefer.

    columns : ndarray of int, shape (n, k); spread : ndarray, shape (n, k, k)
    With the eigenvalues d of ``X C X^T``, z the residual along its vectors and t the squared amplitude,
    -2 log likelihood falls by ``sum(w z^2) - sum(log(1 + t d))``, ``w = t d / (1 + t d)``. Being a
    ratio of likelihoods, e comes by chance at most once in ``exp(e / 2)`` times (Markov).
    """
    half = np.asarray(np.linalg.cholesky(spread + 1e-9 * np.eye(spread.shape[-1])))
    d, along = along_prior(*field.products(columns), half)
    longest = (field.lengths[columns] ** 2).max(axis=-1, initial=0.0)
    seen = d > VISIBLE**2 * longest[:, None]
    d, along = np.where(seen, d, 0.0), np.where(seen, along, 0.0)
    largest = np.where(seen.any(axis=-1), d.max(axis=-1), 1.0)
    squared = np.geomspace(0.1, 1e6, _AMPLITUDES)[:, None] / largest[:, None, None]
    falls, price = marginal_gain(d[:, None], along[:, None], squared)
    evidence = field.evidence(falls) - price
    best = np.argmax(evidence, axis=-1)[:, None]
    e = np.take_along_axis(evidence, best, axis=-1)[:, 0]
    fall = np.take_along_axis(falls, best, axis=-1)[:, 0]
    p = np.exp(-0.5 * np.maximum(e, 0.0))
    return [
        Score(own_fall, own, CURVE_PRICE, chance) if own > 0.0 else NOTHING
        for own_fall, own, chance in zip(fall.tolist(), e.tolist(), p.tolist(), strict=True)
    ]


def weighted_test(field: Field, columns: IntArray, spread: Array) -> tuple[float, float]:
    """Probability of as much of some columns (k,) by chance, and by how much the sum of squares falls.

    With d the variances a priori of their signal along its principal axes and z the residual there, in
    the noise, the statistic is ``sum(w z^2)``, ``w = d / (1 + d)``: directions that what is modelled
    absorbs weigh nothing, where a chi-square would give all the same.

    spread : ndarray, shape (k, k), covariance of their coefficients a priori
    """
    d, along = along_prior(*field.products(columns), cholesky_of(spread))
    longest = float((field.lengths[columns] ** 2).max(initial=0.0))
    seen = d > VISIBLE**2 * float(spread.diagonal().mean()) * longest
    if not seen.any() or field.dof <= np.count_nonzero(seen):
        return 1.0, 0.0
    d = d[seen]
    squares = along[seen] ** 2 / d
    w = d / (d + field.spread)
    statistic = float(w @ squares) / field.spread
    chance = (
        ratio_above(w, field.dof, statistic) if field.noise_refuted else chance_above(w, statistic)
    )
    return chance, float(squares.sum())
