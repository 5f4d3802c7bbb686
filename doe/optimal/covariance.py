"""The covariance of a plan after one of its poses changed, by an update of low rank."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array

_ROUNDING = 1e-14


def lessened(cov: Array, out: Array, share: float) -> Array:
    """Covariance with a share of what a pose tells taken away.

    All of it may well leave the information singular.

    cov : ndarray, shape (p, p); out : ndarray, shape (r, p), the pose's rows; share : float, < 1
    """
    U = out @ cov
    S = np.eye(len(out)) / share - U @ out.T
    return np.asarray(cov + U.T @ np.linalg.solve(S, U))


def fall(cov: Array, G: Array, into: Array) -> Array:
    """By how much poses lower a trace of the covariance, ``tr((I + A C A')^-1 A G A')``, shape (n,).

    cov : ndarray, shape (p, p), C without it; G : ndarray, shape (p, p), ``C W C`` for the trace of
    ``W C``; into : ndarray, shape (n, r, p), rows A of each
    """
    return _trace(np.eye(into.shape[1])[..., None] + _turned(cov, into), _turned(G, into))


def growth(cov: Array, into: Array) -> Array:
    """By how much poses raise the log-determinant of the information, shape (n,).

    cov : ndarray, shape (p, p), without it; into : ndarray, shape (n, r, p), rows of each
    """
    S = np.eye(into.shape[1])[..., None] + _turned(cov, into)
    return np.asarray(np.linalg.slogdet(np.moveaxis(S, 2, 0))[1])


def _turned(G: Array, into: Array) -> Array:
    """``A G A'`` of each pose, shape (r, r, n)."""
    n, r, p = into.shape
    own = (into.reshape(n * r, p) @ G).reshape(into.shape) @ np.swapaxes(into, 1, 2)
    return np.ascontiguousarray(np.moveaxis(own, 0, 2))


def _trace(S: Array, N: Array) -> Array:
    """``tr(S^-1 N)`` of many small symmetric matrices (r, r, n), unknowns put out in turn."""
    total = np.zeros(S.shape[2])
    for least in np.maximum(_ROUNDING * np.abs(np.einsum("rrn->rn", S)), 1.0):
        pivot = np.maximum(np.abs(S[0, 0]), least)  # no less but for rounding
        total += N[0, 0] / pivot
        out = S[1:, 0] / pivot
        half = N[1:, 0] - 0.5 * N[0, 0] * out
        N = N[1:, 1:] - out[:, None] * half - half[:, None] * out
        S = S[1:, 1:] - out[:, None] * S[0, 1:]
    return total
