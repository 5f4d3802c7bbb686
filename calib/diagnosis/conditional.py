"""What candidates are worth beside a set of columns, and how the variances would answer.

With the products ``G = X^T V^-1 X`` of all columns, the set A and its prior precision D,

    B = G_AA + D = L L^T ,   E = L^-1 G_A ,   M = V^-1 - V^-1 A B^-1 A^T V^-1 ,   X^T M X = G - E^T E .

A candidate's coefficients, normal with amplitude a, change -2 log likelihood by

    sum(log(1 + a^2 d)) - sum(a^2 z^2 / (1 + a^2 d))

with d the squares of its columns along their principal axes and z their products with the response.
What it explains no longer counts as scatter. The derivative by the logarithm of a variance whose unit
draws are u, ``sum(u^T M u - (u^T M r)^2)``, changes by

    sum(-tr(K h h^T) + 2 (u^T M r) h^T k - (h^T k)^2)

with ``h = X^T M u``, ``K = (X^T M X + a^-2)^-1`` and ``k = K X^T M r``, and one Newton step tells what
the variances would gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.diagnosis.compressed import Block, Products

_VISIBLE = 1e-9  # of the squared length of columns
_LONGEST = 2.0  # change of the logarithm of a variance in one step
_DIGITS = 1e-13  # of a product: what keeps a set of dependent columns regular


@dataclass(frozen=True, eq=False)
class Curvature:
    """-2 log likelihood about the present variances.

    gradient : ndarray, shape (t,), by log variances; information : ndarray, shape (t, t)
    free : ndarray of bool, shape (t,), whether no bound holds a variance
    """

    gradient: Array
    information: Array
    free: Mask

    def promised(self, change: Array) -> Array:
        """Decrease by one Newton step where the gradient changes by (n, t), shape (n,)."""
        g = (self.gradient + change)[:, self.free]
        A = self.information[np.ix_(self.free, self.free)]
        step = -np.linalg.solve(A, g.T).T
        longest = np.abs(step).max(axis=1, initial=0.0)
        step = step / np.maximum(1.0, longest / _LONGEST)[:, None]
        return np.asarray(-(g * step).sum(axis=1) - 0.5 * ((step @ A) * step).sum(axis=1))


@dataclass(frozen=True, eq=False)
class Conditional:
    """Products conditional on a set of a columns.

    E : ndarray, shape (a, f), all columns along the set; z : ndarray, shape (f,), products with the
        response beside it
    held : ndarray, shape (a, a), ``L^-1 D L^-T``; inverse : ndarray, shape (a, a), ``L^-1``
    own : ndarray of int, shape (a,), columns of the set
    gone : ndarray, shape (k, a), orthonormal directions of the set that were taken out again
    whole : Conditional, of the set before anything was taken out; None where nothing was
    """

    products: Products
    E: Array
    z: Array
    held: Array
    inverse: Array
    own: IntArray
    gone: Array
    whole: Conditional | None = None

    @classmethod
    def of(cls, products: Products, blocks: Sequence[Block]) -> Conditional:
        """Conditional on the design and blocks of columns."""
        from scipy.linalg import solve_triangular

        columns = products.columns
        prior = [np.full(len(own), size**-2.0) for own, size in blocks]
        own = np.concatenate([np.arange(columns.response), *(own for own, _ in blocks)])
        D = np.concatenate([columns.precision, *prior])
        G = products.of(np.append(own, columns.response))
        B = G[:-1, own] + np.diag(D)
        size = np.sqrt(np.diag(B))
        L = np.linalg.cholesky(B / np.outer(size, size) + _DIGITS * np.eye(len(B)))
        E = solve_triangular(L, G[:-1] / size[:, None], lower=True)
        inverse = solve_triangular(L, np.diag(1.0 / size), lower=True)
        z = G[-1] - E[:, columns.response] @ E
        held = (inverse * D) @ inverse.T
        return cls(products, E, z, held, inverse, own, E[:0, :0])

    @cached_property
    def along_draws(self) -> Array:
        """Products of unit draws with the set, (d, a), in its orthonormal directions."""
        return np.asarray(self.products.draws(self.own) @ self.inverse.T)

    @property
    def response(self) -> int:
        """Position of the response."""
        return self.products.columns.response

    def without(self, gone: IntArray) -> Conditional:
        """Conditional on the set without some of its columns."""
        Y = self.inverse[:, np.isin(self.own, gone)]
        W = np.linalg.solve(np.linalg.cholesky(Y.T @ Y), Y.T)
        F = W @ self.E
        return replace(self, z=self.z + F[:, self.response] @ F, gone=W, whole=self)

    def adding(self, own: IntArray, size: float) -> Conditional:
        """The same beside further columns (k,) with a prior standard deviation, for gains alone."""
        across = self.products.of(own) - self.E[:, own].T @ self.E
        C = np.linalg.cholesky(across[:, own] + np.eye(len(own)) / size**2)
        F = np.linalg.solve(C, across)
        E, z = np.concatenate([self.E, F]), self.z - F[:, self.response] @ F
        return replace(self, E=E, z=z)

    def _along(self, own: IntArray) -> Array:
        """Columns (k,) along what is left of the set, shape (a, k)."""
        E = self.E[:, own]
        return np.asarray(E - self.gone.T @ (self.gone @ E) if self.gone.size else E)

    def _draws(self, own: IntArray) -> Array:
        """Products (d, k) of unit draws with columns (k,) beside what is left of the set."""
        along, E = (self.whole or self).along_draws, self.E[:, own]
        H = self.products.draws(own) - along @ E
        if not self.gone.size:
            return H
        return np.asarray(H + (along @ self.gone.T) @ (self.gone @ E))

    def crossed(self, own: IntArray) -> Array:
        """Products (k, f) of columns (k,) with all, beside the set."""
        return np.asarray(self.products.of(own) - self._along(own).T @ self.E)

    def squares(self, own: IntArray) -> Array:
        """Products (n, k, k) of candidates' columns (n, k) beside the set."""
        E = np.moveaxis(self._along(own.ravel()).reshape(-1, *own.shape), 0, 1)
        return np.asarray(self.products.squares(own) - np.swapaxes(E, 1, 2) @ E)

    def gains(self, own: IntArray, amplitudes: Array) -> tuple[Array, Array]:
        """Largest gains (n,) of candidates with columns (n, k), and the amplitudes (n,) with them.

        amplitudes : ndarray, shape (n, s), that are tried
        """
        d, axes = np.linalg.eigh(self.squares(own))
        z = (np.swapaxes(axes, 1, 2) @ self.z[own][..., None])[..., 0]
        seen = d > _VISIBLE * np.trace(self.products.squares(own), axis1=1, axis2=2)[:, None]
        return best_amplitude(np.where(seen, d, 0.0), np.where(seen, z, 0.0), amplitudes)

    def changes(self, own: IntArray, amplitude: Array) -> Array:
        """Changes (n, t) of the gradient by log variances, with amplitudes (n,)."""
        S = self.squares(own)
        K = np.linalg.inv(S + np.eye(own.shape[1]) / amplitude[:, None, None] ** 2)
        k = (K @ self.z[own][..., None])[..., 0]

        def change(N: Array, v: Array) -> Array:
            trace = np.einsum("nkl,nlk->n", K, N)
            square = np.einsum("nk,nkl,nl->n", k, N, k)
            return np.asarray(2.0 * (v * k).sum(axis=1) - square - trace)

        flat, along = self._along(own.ravel()), self._along(np.array([self.response]))[:, 0]
        E = np.moveaxis(flat.reshape(-1, *own.shape), 0, 1)
        held = np.moveaxis((self.held @ flat).reshape(-1, *own.shape), 0, 1)
        total = change(S - np.swapaxes(E, 1, 2) @ held, self.z[own] - along @ held)
        H, r = self._draws(own.ravel()), self._draws(np.array([self.response]))[:, 0]
        found = [total]
        for a, b in pairwise(self.products.ends):
            h = np.moveaxis(H[a:b].reshape(-1, *own.shape), 0, 1)
            found.append(change(np.swapaxes(h, 1, 2) @ h, r[a:b] @ h))
        found[0] = total - sum(
            found[1:], np.zeros(len(own))
        )  # all variances together scale all rows
        return np.stack(found, axis=1)


def best_amplitude(d: Array, z: Array, amplitudes: Array) -> tuple[Array, Array]:
    """Largest gains (n,), and the amplitudes (n,) with them, of n sets of k columns.

    d, z : ndarray, shape (n, k), squares of columns along their axes, and products with the response
    amplitudes : ndarray, shape (n, s)
    """
    a, d = amplitudes[..., None] ** 2, d[:, None]
    gains = (a * z[:, None] ** 2 / (1.0 + a * d) - np.log1p(a * d)).sum(axis=-1)
    best = np.argmax(gains, axis=1)[:, None]
    gain, amplitude = (np.take_along_axis(each, best, axis=1) for each in (gains, amplitudes))
    return gain[:, 0], amplitude[:, 0]
