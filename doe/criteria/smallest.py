"""The worst of several: combinations (E), poses within reach (G), rivals."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.errors import CalibError
from doe.criteria.protocol import Conic, Criterion, Question, solved
from doe.optimal.blocks import pack, trace_decrease, unpack

_SHARPNESS = 60.0  # exponent with which the default supergradient weighs the smallest ones
_LEAST = 1e-300  # a variance is above zero, whatever rounding makes of it
_OTHERS = 4.0  # exponent with which the other eigenvalues count in the ranking


@dataclass(frozen=True, eq=False)
class SmallestEigenvalue(Criterion):
    """E: the worst-known parameter combination, in multiples of usual sizes.

    ``Phi = 1 / lambda_max(V M^-1 V^T)``

    V : ndarray, shape (s, p), the parameters that matter, each in its plausible size
    """

    V: Array
    name: ClassVar[str] = "E"
    unit: ClassVar[str] = "smallest eigenvalue of M, parameters in plausible sizes"
    larger_is_better: ClassVar[bool] = True

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.chosen(question.sized))

    def value(self, M: Array) -> Array:
        cov = self.V @ solved(M, self.V.T)
        return np.asarray(1.0 / np.linalg.eigvalsh(cov)[..., -1])

    def gradient(self, M: Array) -> Array:
        W = solved(M, self.V.T)
        _, vectors = np.linalg.eigh(self.V @ W)
        z = W @ vectors[:, -1:]
        return np.asarray(self.value(M) ** 2 * z @ z.T)

    def gain(self, cov: Array, rows: Array) -> Array:
        W = cov @ self.V.T
        values, vectors = np.linalg.eigh(self.V @ W)
        z = W @ (vectors * np.maximum(values / values[-1], 0.0) ** _OTHERS)
        return trace_decrease(cov, z @ z.T, rows)

    def conic(self, M: Any) -> Conic:
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


@dataclass(frozen=True, eq=False)
class Smallest(Criterion):
    """``Phi = min_k Phi_k``, each of the K members an information function."""

    whole: ClassVar[bool] = False

    @abstractmethod
    def members(self, M: Array) -> Array:
        """``Phi_k(M)``, shape (..., K)."""

    @abstractmethod
    def member_gradient(self, M: Array, weights: Array) -> Array:
        """A supergradient of a concave function that lies above the smallest, shape (p, p)."""

    def value(self, M: Array) -> Array:
        return np.asarray(self.members(M).min(axis=-1))

    def gradient(self, M: Array) -> Array:
        members = self.members(M)
        weights = (members.min() / members) ** _SHARPNESS
        return self.member_gradient(M, weights / weights.sum())


@dataclass(frozen=True, eq=False)
class WorstRegion(Smallest):
    """G: largest variance of a predicted reading, summed over its markers, in noise variances.

    ``Phi_k = 1 / tr(F_k^T M^-1 F_k)``; F : ndarray, shape (K, p, r)
    """

    F: Array
    name: ClassVar[str] = "G"
    unit: ClassVar[str] = "largest variance of a predicted pose, in noise variances"

    @classmethod
    def of(cls, question: Question) -> Self:
        values, vectors = np.linalg.eigh(question.region)
        return cls(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])

    @cached_property
    def _packed(self) -> Array:
        """``F_k F_k^T``, packed, shape (K, p (p + 1) / 2)."""
        C: Array = self.F @ np.swapaxes(self.F, -1, -2)
        return pack(C)

    def members(self, M: Array) -> Array:
        variance = pack(np.asarray(np.linalg.inv(M))) @ self._packed.T
        return np.asarray(1.0 / np.maximum(variance, _LEAST))

    def member_gradient(self, M: Array, weights: Array) -> Array:
        # Gradient of 1 / tr(C M^-1) with C the weighted sum: it lies above the smallest member.
        C = unpack(weights @ self._packed)
        V = np.linalg.inv(M)
        return np.asarray(V @ C @ V / float((V * C).sum()) ** 2)


@dataclass(frozen=True, eq=False)
class Rivals(Smallest):
    """Two effects are separated, whichever of them is the true one.

    Each effect in turn is taken as true, with its usual size, and everything else is fitted, the rival
    included. The residual that remains is ``delta^T K delta``, in noise variances, where K is the Schur
    complement of M (T-optimality of Atkinson and Fedorov, Biometrika 62(1), 1975, for linear rivals).

    V : tuple of two ndarray, shape (s_k, p), the parameters of either effect in plausible sizes
    """

    V: tuple[Array, Array]

    name: ClassVar[str] = "discriminate"
    unit: ClassVar[str] = "squared residual of the worse rival, in noise variances"
    larger_is_better: ClassVar[bool] = True

    @classmethod
    def of(cls, question: Question) -> Self:
        if question.rivals is None:
            raise CalibError("two rival effects are needed; name those to discriminate")
        first, second = (question.sized[rows] for rows in question.rivals)
        return cls((first, second))

    def _directions(self, M: Array) -> list[Array]:
        """``M^-1 V^T K delta`` of both, shape (..., p, 1); delta is one size of every parameter."""
        directions = []
        for V in self.V:
            W = solved(M, V.T)
            delta = np.full((len(V), 1), len(V) ** -0.5)
            directions.append(np.asarray(W @ solved(V @ W, delta)))
        return directions

    def members(self, M: Array) -> Array:
        values = [np.swapaxes(d, -1, -2) @ M @ d for d in self._directions(M)]
        return np.concatenate(values, axis=-1)[..., 0, :]

    def member_gradient(self, M: Array, weights: Array) -> Array:
        first, second = self._directions(M)
        return np.asarray(weights[0] * first @ first.T + weights[1] * second @ second.T)
