"""The score test: how much of what is left each candidate would explain.

With the whitened derivatives N of everything modelled and r the residual, a candidate with columns X is
judged by ``S = |U^T r|^2``, U an orthonormal basis of what is left of X once N is projected out. Where
nothing is missing S is chi-square with as many degrees of freedom as U has columns; an effect that is
there adds its noncentrality (Rao 1948; one QR of N serves all candidates).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.poses import IntArray
from calib.se3 import Array

VISIBLE = 1e-3
"""Share of a column's length that must be left beside the modelled ones for it to count."""
CURVE_PRICE = float(2.0 * np.log(10.0))
"""Of having no name."""
_DEPENDENT = 1e-8
_AMPLITUDES = 24
_AGREES = 0.01  # probability below which the residual refutes the stated noise


@dataclass(frozen=True, eq=False)
class Field:
    """Columns and residual with everything modelled projected out.

    X : ndarray, shape (N, K); r : ndarray, shape (N,), in standard deviations
    lengths : ndarray, shape (K,), of the columns before the projection
    rows : int, that count; dof : int, degrees of freedom of r
    """

    X: Array
    r: Array
    lengths: Array
    rows: int
    dof: int

    @property
    def cost(self) -> float:
        """Sum of squares of the residual."""
        return float(self.r @ self.r)

    @property
    def noise_refuted(self) -> bool:
        """Whether the residual's size contradicts the stated noise, in either direction."""
        return refuted(self.cost, self.dof)

    def basis(self, columns: IntArray) -> Array:
        """Orthonormal directions (N, k) of some columns, those that cannot be seen left out."""
        own = self.X[:, columns]
        lengths = np.where(self.lengths[columns] > 0.0, self.lengths[columns], 1.0)
        values, vectors = np.linalg.eigh((own / lengths).T @ (own / lengths))
        seen = values > VISIBLE**2
        return np.asarray((own / lengths) @ vectors[:, seen] / np.sqrt(values[seen]))


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
    from scipy.linalg import qr

    scale = np.linalg.norm(N, axis=0)
    Q, R, _ = qr(N / np.where(scale > 0.0, scale, 1.0), mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    Q = Q[:, pivots > _DEPENDENT * pivots.max(initial=0.0)]
    rows = int(np.count_nonzero(np.abs(N).sum(axis=1) + np.abs(X).sum(axis=1)))
    lengths = np.linalg.norm(X, axis=0)
    X, r = X - Q @ (Q.T @ X), r - Q @ (Q.T @ r)
    return Field(X, r, lengths, rows, rows - Q.shape[1])


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


NOTHING = Score(0.0, 0.0, 0.0, 1.0)


def score(
    field: Field, columns: IntArray, spread: Array | None = None, limits: Array | None = None
) -> Score:
    """Score of a candidate with these columns.

    spread : ndarray, shape (k, k), covariance of a curve's coefficients a priori
    limits : ndarray, shape (k,), of a named cause's parameters, SI: one standard deviation a priori;
        any size without them
    """
    return _named(field, columns, limits) if spread is None else _curve(field, columns, spread)


def _named(field: Field, columns: IntArray, limits: Array | None) -> Score:
    """Score test: chi-square where the noise is believed, F where the residual refutes it.

    Of what the readings ask for counts what the plausible sizes can give: with G the covariance a
    priori of the signal in the directions U, ``fall = z^T G (I + G)^-1 z``.
    """
    from scipy.special import chdtrc, fdtrc

    U = field.basis(columns)
    k = U.shape[1]
    if k == 0:
        return NOTHING
    price = k * float(np.log(field.rows))
    z = U.T @ field.r
    fall = float(z @ z)
    if limits is not None:
        half = U.T @ (field.X[:, columns] * limits)
        G = half @ half.T
        fall = float(z @ np.linalg.solve(np.eye(k) + G, G @ z))
    left = field.dof - k
    if not field.noise_refuted or left <= 0:
        return Score(fall, fall, price, float(chdtrc(k, fall)))
    rest = max(field.cost - fall, 1e-300)
    evidence = field.dof * float(np.log(field.cost / rest))
    return Score(fall, evidence, price, float(fdtrc(k, left, fall / k / (rest / left))))


def _curve(field: Field, columns: IntArray, spread: Array) -> Score:
    """Marginal likelihood of normal coefficients, at the amplitude that the data prefer.

    With the eigenvalues d of ``X C X^T``, z the residual along its vectors and t the squared amplitude,
    -2 log likelihood falls by ``sum(w z^2) - sum(log(1 + t d))``, ``w = t d / (1 + t d)``. Being a
    ratio of likelihoods, e comes by chance at most once in ``exp(e / 2)`` times (Markov).
    """
    half = np.linalg.cholesky(spread + 1e-9 * np.eye(len(spread)))
    X = field.X[:, columns] @ half
    d, vectors = np.linalg.eigh(X.T @ X)
    seen = d > VISIBLE**2 * float((field.lengths[columns] ** 2).max(initial=0.0))
    if not seen.any():
        return NOTHING
    d, vectors = d[seen], vectors[:, seen]
    z = (vectors.T @ (X.T @ field.r)) / np.sqrt(d)
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
