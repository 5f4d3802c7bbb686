"""How visible causes are beside the model and the others, and what a fit of them leaves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import qr, solve_triangular

from studies.research.truth.arms import Array, Mask
from studies.research.truth.causes import Cause
from studies.research.truth.effects import TUNED, is_outside
from studies.research.truth.mechanism import Mechanism, State, frame_columns
from studies.research.truth.scene import Scene, at_rest

# Relative sizes of a diagonal of R below which a column is a sum of others: of the model, of causes.
_SAME, _SAME_COLUMN = 1e-8, 1e-3


def modelled_columns(scene: Scene, state: State) -> Array:
    """Derivatives of the points by all that the user's model leaves free, (N, M, 3, p), base axes."""
    arm, (N, M) = scene.arm, state.points.shape[:2]
    columns = [
        frame_columns(state, k)
        for k in range(1 if scene.conditions.known_geometry else arm.dof + 2)
    ]
    for marker in range(M):
        alone = np.zeros((N, M, 3, 3))
        alone[:, marker] = state.R_link[:, -1]
        columns.append(alone)
    for name in scene.modelled:
        k = scene.index(name)
        turn = frame_columns(state, k + 1)[..., 3:] @ arm.axes[k]
        columns.append((turn * state.torque[:, None, None, k])[..., None])
    return np.concatenate(columns, axis=-1)


class Projector:
    """Takes out of a displacement what the user's model can take up, under the true covariance.

    seen : ndarray of bool, shape (N, M), the points that the fit has
    """

    def __init__(self, scene: Scene, state: State, seen: Mask) -> None:
        self._scene, self._seen, self._points = scene, seen, state.readings[seen]
        self._approaches = self._factors(state)
        J = self.white(modelled_columns(scene, state))
        J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        Q, R, _ = qr(J, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(R))
        self._Q = Q[:, diagonal > _SAME * diagonal[0]]

    def white(self, columns: Array) -> Array:
        """Columns (N, M, 3, p) in base axes at the points of the fit, whitened, (3 * points, p)."""
        return self._decorrelated(self._in_noise(columns))

    def left(self, moved: Array) -> Array:
        """What is left of readings moved by (N, M, 3), m, whitened, shape (3 * points,)."""
        white = self._scene.noise.whitened(moved[self._seen], self._points)
        r = self._decorrelated(white.ravel())
        return np.asarray(r - self._Q @ (self._Q.T @ r))

    def span(self, columns: Array) -> Array:
        """What is left of each of columns (N, M, 3, p), shape (3 * points, p)."""
        return np.stack([self.left(column) for column in np.moveaxis(columns, -1, 0)], axis=1)

    def _in_noise(self, columns: Array) -> Array:
        turned = np.swapaxes(columns[self._seen], -1, -2) @ self._scene.R.T
        white = self._scene.noise.whitened(turned, self._points[:, None])
        return np.swapaxes(white, -1, -2).reshape(-1, columns.shape[-1])

    def _factors(self, state: State) -> list[tuple[slice, Array]]:
        """Rows of each approach, and the Cholesky factor of their covariance in instrument noise."""
        scene = self._scene
        if scene.scatter is None:
            return []
        A = self._in_noise(scene.scatter.columns(scene.arm, state))
        visit = np.repeat(scene.session.visit, self._seen.sum(axis=1))
        ends = 3 * np.flatnonzero(np.diff(visit, prepend=-1, append=-1))
        rows = [slice(int(i), int(j)) for i, j in pairwise(ends)]
        blocks = [A[at] for at in rows]
        roots = [np.asarray(np.linalg.cholesky(np.eye(len(B)) + B @ B.T)) for B in blocks]
        return list(zip(rows, roots, strict=True))

    def _decorrelated(self, rows: Array) -> Array:
        """Rows in instrument noise, made independent of each other where an approach is shared."""
        free = rows.copy()
        for at, L in self._approaches:
            free[at] = solve_triangular(L, rows[at], lower=True)
        return free


def given(rest: Array, other: Array) -> float:
    """Noncentrality of one displacement beside another, both projected."""
    size = float(other @ other)
    beside = rest - (float(other @ rest) / size if size > 0.0 else 0.0) * other
    return float(beside @ beside)


def tangents(scene: Scene, mechanism: Mechanism, still: State, cause: Cause) -> Array:
    """What each linear parameter of a cause moves alone, (N, M, 3, parameters), m, instrument frame.

    By differences of the simulator at the true size; tuned parameters keep their true values.
    """
    if cause.act is not None or is_outside(cause.effect):  # nobody fits a parameter of it
        return (at_rest(scene, mechanism, [cause]).readings - still.readings)[..., None]
    names = [name for name in cause.values if name not in TUNED]

    def moved(name: str) -> Array:
        others = {other: 0.0 for other in names if other != name}
        one = Cause(cause.effect, cause.where, {**cause.values, **others}, cause.size)
        return np.asarray(at_rest(scene, mechanism, [one]).readings - still.readings)

    return np.stack([moved(name) for name in names], axis=-1)


def beside_others(rests: Sequence[Array], spans: Sequence[Array]) -> tuple[float, ...]:
    """Noncentrality of each displacement beside all that the others' parameters could do.

    rests : ndarrays, shape (P,), whitened and projected; spans : of each cause, shape (P, parameters)
    """
    found = []
    for i, rest in enumerate(rests):
        others = [span for k, span in enumerate(spans) if k != i]
        left = rest - _within_span(np.hstack(others), rest) if others else rest
        found.append(float(left @ left))
    return tuple(found)


def _within_span(columns: Array, rest: Array) -> Array:
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not kept.size:
        return np.zeros_like(rest)
    Q, R, _ = qr(kept, mode="economic", pivoting=True)
    Q = Q[:, np.abs(np.diag(R)) > _SAME_COLUMN]
    return np.asarray(Q @ (Q.T @ rest))
