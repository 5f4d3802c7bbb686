"""What further columns would do to the restricted likelihood, to second order in the variances.

Columns of a suspect lower ``y^T P y`` by ``fall`` at the variances as they are; they leave less to
scatter, and with variances found anew the likelihood gains once more. One step of Fisher's scoring
promises how much: its information does not follow from the readings and is the same for all suspects,
its gradient takes one residual of each. For n coordinates of one variance that falls by a share x the
sum is ``n (x + x^2 / 2)`` where the exact gain is ``-n log(1 - x)``: never too much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.scatter.restricted import (
    Independent,
    Likelihood,
    MixedModel,
    independent,
    likelihood,
    step,
)


@dataclass(frozen=True, eq=False)
class Gain:
    """What a suspect brings: ``fall`` at the variances as they are, ``promised`` by finding them anew.

    triangle : ndarray, shape (k, k), of its columns beside what is known, its prior's rows included
    """

    fall: float
    promised: float
    triangle: Array


@dataclass(frozen=True, eq=False)
class NearbyLikelihood:
    """The restricted likelihood of known columns and suspects, near some variances.

    problem : MixedModel; theta : ndarray, shape (v,); free : ndarray of int, those that may move
    """

    problem: MixedModel
    theta: Array
    free: IntArray

    @cached_property
    def _rows(self) -> Independent:
        return independent(self.problem, self.theta)

    @cached_property
    def _alone(self) -> tuple[Likelihood, Array, float]:
        """The likelihood of the known columns alone, its pulls (v,), and what a step promises."""
        known = self.problem.known
        chosen = np.append(np.arange(known), self.problem.outside.shape[1] - 1)
        found = likelihood(self.problem.with_columns(chosen, known), self.theta)
        pulls = self._pulls(np.zeros(0, dtype=int), np.zeros(0))
        return found, pulls, step(found, self.theta, self.free)[1]

    @cached_property
    def _products(self) -> tuple[Array, Array]:
        """Of suspects and readings beside the known columns, and the known ones' share in each.

        Shapes (f - p, f - p) and (p, f - p).
        """
        from scipy.linalg import solve_triangular

        p, G = self.problem.known, self._rows.products
        R = self._rows.triangle_of(p)
        B = solve_triangular(R, G[:p, p:], trans="T")
        return G[p:, p:] - B.T @ B, np.asarray(solve_triangular(R, B))

    def conditional(self, own: IntArray) -> tuple[Array, Array]:
        """Products (k, k) of columns ``own`` beside the known ones, and (k,) with the readings."""
        S, at = self._products[0], own - self.problem.known
        return S[np.ix_(at, at)], S[at, -1]

    def gain(self, own: IntArray, prior: Array) -> Gain:
        """Of a suspect with columns ``own`` (k,) and rows (h, k) of unit variance beside them."""
        S, right = self.conditional(own)
        A = S + prior.T @ prior
        scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
        unit = np.linalg.cholesky(A / np.outer(scale, scale) + 1e-12 * np.eye(len(own)))
        L = unit * scale[:, None]
        z = np.linalg.solve(L, right)
        promised = 0.0
        if len(self.free):
            alone, pulls, unmoved = self._alone
            changed = self._pulls(own, np.linalg.solve(L.T, z)) - pulls
            there = replace(alone, gradient=alone.gradient - changed)
            promised = step(there, self.theta, self.free)[1] - unmoved
        return Gain(float(z @ z), promised, L.T)

    def _pulls(self, own: IntArray, values: Array) -> Array:
        """``y^T P V_j P y`` by every variance, shape (v,), with columns ``own`` at values (k,)."""
        p, share = self.problem.known, self._products[1]
        combined = np.zeros(self.problem.outside.shape[1])
        combined[own] = -values
        combined[:p] = share[:, own - p] @ values - share[:, -1]
        combined[-1] = 1.0
        return self._rows.pulls(combined)
