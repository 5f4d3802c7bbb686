"""The score test: how much of what is left each candidate would explain.

With the whitened derivatives N of everything modelled and r the residual, a candidate with columns X is
judged by ``S = |U^T r|^2``, U an orthonormal basis of what is left of X once N is projected out. Where
nothing is missing S is chi-square with as many degrees of freedom as U has columns; an effect that is
there adds its noncentrality (Rao 1948; one QR of N serves all candidates).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from dataclasses import field as field_
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.elimination import idle

VISIBLE = 1e-3
"""Share of a column's length that must be left beside the modelled ones for it to count."""
CURVE_PRICE = float(2.0 * np.log(10.0))
"""Of having no name."""
DEPENDENT = 1e-8
"""Share of a column's length below which nothing but rounding is left of it."""
_AMPLITUDES = 24
_AGREES = 0.01  # probability below which the residual refutes the stated noise


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
        return self._projected(np.arange(self.columns.shape[1]))

    @cached_property
    def hidden(self) -> Array:
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

    def products(self, columns: IntArray) -> tuple[Array, Array]:
        """``X^T X`` and ``X^T r`` of some columns, shapes (k, k) and (k,)."""
        key = columns.tobytes()
        if key not in self._products:
            own = self.columns[:, columns]
            S, z = own.T @ own, own.T @ self.r
            if self.modelled is not None:
                H = self.hidden[:, columns]
                S, z = S - H.T @ H, z - H.T @ (self.modelled.T @ self.r)
            if self.whole is not None:
                S_whole, z_whole = self.whole.products(columns)
                S, z = S + S_whole, z + z_whole
            self._products[key] = S, z
        return self._products[key]

    def crossed(self, these: IntArray, those: IntArray) -> Array:
        """``X^T X`` of some columns with others, shape (k, l)."""
        own = self.columns[:, these].T @ self.columns[:, those]
        if self.modelled is not None:
            own = own - self.hidden[:, these].T @ self.hidden[:, those]
        return own if self.whole is None else own + self.whole.crossed(these, those)

    def compressed(self) -> Field:
        """The same products and cost in as few rows as there are columns."""
        R = np.asarray(np.linalg.qr(np.column_stack([self.X, self.r]), mode="r"))
        return Field(R[:, :-1], R[:, -1], self.lengths, self.rows, self.dof)

    def take(self, columns: IntArray) -> Field:
        """The field of some columns alone, all rows in one."""
        X, r, part = self._projected(columns), self.r, self.whole
        while part is not None:
            X, r = np.concatenate([part._projected(columns), X]), np.concatenate([part.r, r])
            part = part.whole
        return Field(X, r, self.lengths[columns], self.rows, self.dof)

    def _projected(self, columns: IntArray) -> Array:
        own = self.columns[:, columns]
        return own if self.modelled is None else own - self.modelled @ self.hidden[:, columns]

    def basis(self, columns: IntArray) -> Array:
        """Orthonormal directions (N, k) of some columns, those that cannot be seen left out."""
        own, T = self.take(columns).X, self.directions(columns)
        return np.asarray(own @ T)

    def directions(self, columns: IntArray) -> Array:
        """``T``, shape (K, k), that makes columns (N, K) the orthonormal directions ``X T``."""
        S, _ = self.products(columns)
        lengths = np.where(self.lengths[columns] > 0.0, self.lengths[columns], 1.0)
        values, vectors = np.linalg.eigh(S / np.outer(lengths, lengths))
        seen = values > VISIBLE**2
        return np.asarray(vectors[:, seen] / np.sqrt(values[seen]) / lengths[:, None])


def refuted(cost: float, dof: int) -> bool:
    """Whether a sum of squares of so many degrees of freedom is no chi-square."""
    from scipy.special import chdtr, chdtrc

    if dof <= 0:
        return False
    return 2.0 * min(float(chdtr(dof, cost)), float(chdtrc(dof, cost))) < _AGREES


def field(N: Array, X: Array, r: Array) -> Field:
    """Project the modelled columns out of candidates and residual.

    N : ndarray, shape (rows, p), whitened derivatives of what is modelled; X : ndarray, shape (rows, K)
    r : ndarray, shape (rows,), whitened residuals; rows of zeros count nothing
    """
    return beside(N, orthonormal(N), X, r)


def beside(N: Array, Q: Array, X: Array, r: Array) -> Field:
    """The same with an orthonormal basis Q (rows, k) of what is modelled."""
    rows = int(np.count_nonzero(N.any(axis=1) | X.any(axis=1)))
    lengths = np.linalg.norm(X, axis=0)
    return Field(X, r - Q @ (Q.T @ r), lengths, rows, rows - Q.shape[1], Q)


def orthonormal(N: Array) -> Array:
    """An orthonormal basis of columns (rows, p), shape (rows, rank)."""
    from scipy.linalg import qr

    scale = np.linalg.norm(N, axis=0)
    Q, R, _ = qr(N / np.where(scale > 0.0, scale, 1.0), mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    return np.asarray(Q[:, pivots > DEPENDENT * pivots.max(initial=0.0)])


@dataclass(frozen=True)
class Score:
    """What one candidate would explain.

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
        """Evidence less its price."""
        return self.evidence - self.price

    def counted(self, tried: int) -> Score:
        """The score of the best of so many."""
        if tried == 1:
            return self
        price = self.price + 2.0 * float(np.log(tried))
        return replace(self, price=price, p=min(1.0, self.p * tried))


NOTHING = Score(0.0, 0.0, 0.0, 1.0)


def score(
    field: Field,
    columns: IntArray,
    spread: Array | None = None,
    limits: Array | None = None,
    sparing: bool = False,
) -> Score:
    """Score of a candidate with these columns.

    spread : ndarray, shape (k, k), covariance of a curve's coefficients a priori
    limits : ndarray, shape (k,), of a named cause's parameters, SI: one standard deviation a priori;
        any size without them
    sparing : whether of a named cause's parameters only those count that pay
    """
    if spread is not None:
        return _curve(field, columns, spread)
    if sparing and limits is not None:
        return _spared(field, columns, limits)
    return _named(field, columns, limits)


def _named(field: Field, columns: IntArray, limits: Array | None) -> Score:
    """Score test: chi-square where the noise is believed, F where the residual refutes it.

    Of what the readings ask for counts what the plausible sizes can give: with G the covariance a
    priori of the signal in the directions U, ``fall = z^T G (I + G)^-1 z``.
    """
    from scipy.special import chdtrc, fdtrc

    T, (S, Xr) = field.directions(columns), field.products(columns)
    k = T.shape[1]
    if k == 0:
        return NOTHING
    price = k * float(np.log(field.rows))
    z = T.T @ Xr
    fall = float(z @ z)
    if limits is not None:
        half = T.T @ S * limits
        G = half @ half.T
        fall = float(z @ np.linalg.solve(np.eye(k) + G, G @ z))
    left = field.dof - k
    if not field.noise_refuted or left <= 0:
        return Score(fall, fall, price, float(chdtrc(k, fall)))
    rest = max(field.cost - fall, 1e-300)
    evidence = field.dof * float(np.log(field.cost / rest))
    return Score(fall, evidence, price, float(fdtrc(k, left, fall / k / (rest / left))))


def _spared(field: Field, columns: IntArray, limits: Array) -> Score:
    """Score of the parameters that pay, and for the choice of so many among all.

    With the largest believable sizes as a normal prior, taking one out again lets the sum of squares
    rise by its squared estimate over its variance.
    """
    from scipy.special import chdtrc, gammaln

    S, Xr = field.products(columns)
    cov = np.asarray(np.linalg.inv(S + np.diag(1.0 / limits**2)), dtype=np.float64)
    values, K = cov @ Xr, len(columns)
    spread = field.cost / field.dof if field.noise_refuted else 1.0
    each = float(np.log(field.rows)) + 2.0 * float(np.log(2.0))
    gone, rise = idle(values, cov, each * spread)
    fall, k = float(Xr @ values) - rise, int(np.count_nonzero(~gone))
    if k == 0:
        return NOTHING
    choices = float(gammaln(K + 1) - gammaln(k + 1) - gammaln(K - k + 1))
    price = k * float(np.log(field.rows)) + 2.0 * choices
    evidence = fall
    if field.noise_refuted:
        evidence = field.dof * float(np.log(field.cost / max(field.cost - fall, 1e-300)))
    p = float(chdtrc(k, fall / spread)) * float(np.exp(min(choices, 700.0)))
    return Score(fall, evidence, price, min(1.0, p))


def _curve(field: Field, columns: IntArray, spread: Array) -> Score:
    """Marginal likelihood of normal coefficients, at the amplitude that the data prefer.

    With the eigenvalues d of ``X C X^T``, z the residual along its vectors and t the squared amplitude,
    -2 log likelihood falls by ``sum(w z^2) - sum(log(1 + t d))``, ``w = t d / (1 + t d)``. Being a
    ratio of likelihoods, e comes by chance at most once in ``exp(e / 2)`` times (Markov).
    """
    half = np.linalg.cholesky(spread + 1e-9 * np.eye(len(spread)))
    S, Xr = field.products(columns)
    d, vectors = np.linalg.eigh(half.T @ S @ half)
    seen = d > VISIBLE**2 * float((field.lengths[columns] ** 2).max(initial=0.0))
    if not seen.any():
        return NOTHING
    d, vectors = d[seen], vectors[:, seen]
    z = (vectors.T @ (half.T @ Xr)) / np.sqrt(d)
    t = np.geomspace(0.1, 1e6, _AMPLITUDES)[:, None] / d.max()
    falls = (z**2 * t * d / (1.0 + t * d)).sum(axis=1)
    price = np.log1p(t * d).sum(axis=1)
    evidence = falls - price
    if field.noise_refuted:
        evidence = field.dof * np.log(field.cost / np.maximum(field.cost - falls, 1e-300)) - price
    best = int(np.argmax(evidence))
    e = float(evidence[best])
    if e <= 0.0:
        return NOTHING
    return Score(float(falls[best]), e, CURVE_PRICE, float(np.exp(-0.5 * e)))
