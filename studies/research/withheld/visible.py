"""How visible a cause is: the noncentrality of its displacement beside everything modelled."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from studies.research.withheld.actions import Action, State, frame_columns
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Mechanism

_SAME = 1e-8  # relative size of a diagonal of R below which a column is a sum of others


class Acting(Protocol):
    """Anything that moves the arm: a cause, or the arm's own scatter."""

    def add_to(self, action: Action, scene: Scene, state: State) -> None:
        """Add what it does in a state."""


def at_rest(scene: Scene, mechanism: Mechanism, causes: Sequence[Acting]) -> State:
    """The arm under the known loads and some causes."""

    def act(state: State) -> Action:
        action = scene.known(state)
        for cause in causes:
            cause.add_to(action, scene, state)
        return action

    return mechanism.rest(scene.session.q, act, (scene.R, scene.p))


def modelled_columns(scene: Scene, state: State) -> Array:
    """Derivatives of the points by all that the user's model leaves free, (N, M, 3, p), base axes."""
    arm = scene.arm
    N, M = state.points.shape[:2]
    frames = range(arm.dof + 2) if not scene.known_geometry else range(1)
    found = [frame_columns(state, frame) for frame in frames]
    for marker in range(M):
        own = np.zeros((N, M, 3, 3))
        own[:, marker] = state.R_link[:, -1]
        found.append(own)
    for name in scene.modelled:
        k = arm.names.index(name)
        twist = frame_columns(state, k + 1)[..., 3:] @ arm.axes[k]
        found.append((twist * state.torque[:, None, None, k])[..., None])
    return np.concatenate(found, axis=-1)


class Projector:
    """Takes out of a displacement what the user's model can take up, under the true covariance.

    seen : ndarray of bool, shape (N, M), the points that the fit has
    """

    def __init__(self, scene: Scene, state: State, seen: NDArray[np.bool_]) -> None:
        self._seen = seen
        self._noise, self._points = scene.noise, state.readings[seen]
        self._R = scene.R
        self._approaches = self._factors(scene, state)
        J = self.white(modelled_columns(scene, state))
        J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        Q, R, _ = qr(J, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(R))
        self._Q = Q[:, diagonal > _SAME * diagonal[0]]

    def white(self, columns: Array) -> Array:
        """Columns (N, M, 3, p) in base axes at the points of the fit, whitened, (3 * points, p)."""
        turned = np.swapaxes(columns[self._seen], -1, -2) @ self._R.T
        white = np.swapaxes(self._noise.whitened(turned, self._points[:, None]), -1, -2)
        return self._decorrelated(white.reshape(-1, columns.shape[-1]))

    def left(self, moved: Array) -> Array:
        """What is left of readings moved by (N, M, 3), m, whitened, shape (3 * points,)."""
        r = self._decorrelated(self._noise.whitened(moved[self._seen], self._points).ravel())
        rest: Array = r - self._Q @ (self._Q.T @ r)
        return rest

    def _factors(self, scene: Scene, state: State) -> list[tuple[slice, Array]]:
        """Rows of each approach, and the Cholesky factor of their covariance in instrument noise."""
        if scene.scatter is None:
            return []
        moved = scene.scatter.columns(scene.arm, state)[self._seen]
        columns = np.swapaxes(moved, -1, -2) @ scene.R.T
        white = np.swapaxes(self._noise.whitened(columns, self._points[:, None]), -1, -2)
        A = white.reshape(-1, columns.shape[1])
        visit = np.repeat(scene.session.visit, self._seen.sum(axis=1))
        ends = 3 * np.flatnonzero(np.diff(visit, prepend=-1, append=-1))
        rows = [slice(int(i), int(j)) for i, j in pairwise(ends)]
        blocks = [A[own] for own in rows]
        roots = [np.asarray(np.linalg.cholesky(np.eye(len(B)) + B @ B.T)) for B in blocks]
        return list(zip(rows, roots, strict=True))

    def _decorrelated(self, rows: Array) -> Array:
        """Rows in instrument noise, made independent of each other where an approach is shared."""
        found = rows.copy()
        for own, L in self._approaches:
            found[own] = solve_triangular(L, rows[own], lower=True)
        return found


def given(rest: Array, other: Array) -> float:
    """Noncentrality of one displacement beside another, both projected."""
    size = float(other @ other)
    along = float(rest @ other) / size if size > 0.0 else 0.0
    beside = rest - along * other
    return float(beside @ beside)
