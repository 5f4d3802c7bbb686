"""E: the worst-known parameter combination, in multiples of usual sizes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from doe.criteria.protocol import Conic, Criterion, Question, solved

_SMOOTHED = 4.0  # exponent with which the other eigenvalues have a say in the ranking


@dataclass(frozen=True, eq=False)
class SmallestEigenvalue(Criterion):
    """``Phi = 1 / lambda_max(V M^-1 V^T)``.

    V : ndarray, shape (s, p), the parameters that matter, each in its plausible size
    """

    V: Array
    name: ClassVar[str] = "E"
    unit: ClassVar[str] = "smallest eigenvalue of M, parameters in plausible sizes"
    larger_is_better: ClassVar[bool] = True

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.chosen(question.sized))

    @property
    def whole(self) -> bool:
        return bool(self.V.shape[0] == self.V.shape[1])

    def value(self, M: Array) -> Array:
        cov = self.V @ solved(M, self.V.T)
        return np.asarray(1.0 / np.linalg.eigvalsh(cov)[..., -1])

    def gradient(self, M: Array) -> Array:
        W = solved(M, self.V.T)
        _, vectors = np.linalg.eigh(self.V @ W)
        z = W @ vectors[:, -1:]
        return np.asarray(self.value(M) ** 2 * z @ z.T)

    def leaning(self, cov: Array) -> Array:
        W = cov @ self.V.T
        values, vectors = np.linalg.eigh(self.V @ W)
        z = W @ (vectors * np.maximum(values / values[-1], 0.0) ** _SMOOTHED)
        return np.asarray(z @ z.T)

    def conic(self, M: Any, at: Array) -> Conic:
        import cvxpy as cp

        scale = np.linalg.norm(self.V, 2)
        VtV = self.V.T @ self.V / scale**2
        smallest = cp.Variable()
        above = M - smallest * VtV >> 0

        def witness() -> Array:
            # Any Z >= 0 with <V^T V, Z> = 1 bounds the criterion: M' >= t V^T V gives <Z, M'> >= t.
            values, vectors = np.linalg.eigh(above.dual_value)
            Z = (vectors * np.maximum(values, 0.0)) @ vectors.T
            return np.asarray(Z / (VtV * Z).sum() / scale**2)

        return Conic(smallest, [above], witness)
