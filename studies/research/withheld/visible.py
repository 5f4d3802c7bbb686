"""How visible causes are beside the model and the others, and what a fit of them leaves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from studies.research.withheld.causes import Cause, Foreign
from studies.research.withheld.effects import BEYOND, OUTSIDE, TUNED
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.truth import Action, Mechanism, State, frame_columns

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


_SAME_COLUMN = 1e-3  # relative size of a diagonal of R below which a column is a sum of others


def tangents(scene: Scene, mechanism: Mechanism, still: State, cause: Cause) -> Array:
    """What each linear parameter of a cause moves alone, (N, M, 3, parameters), m, instrument frame.

    By differences of the simulator at the true size; cycles, time constants and moments stand at
    their true values.
    """
    # Of which nobody fits a parameter.
    if isinstance(cause, Foreign) or cause.effect in (*OUTSIDE, *BEYOND):
        return (at_rest(scene, mechanism, [cause]).readings - still.readings)[..., None]
    names = [name for name in cause.values if name not in TUNED]
    tuned = {name: value for name, value in cause.values.items() if name in TUNED}

    def moved(values: dict[str, float]) -> Array:
        one = Cause(cause.effect, cause.where, {**dict.fromkeys(names, 0.0), **values, **tuned})
        bent = at_rest(scene, mechanism, [one.sized(cause.size)])
        return np.asarray(bent.readings - still.readings)

    return np.stack([moved({name: cause.values[name]}) for name in names], axis=-1)


def projected(projector: Projector, columns: Array) -> Array:
    """Columns (N, M, 3, p) whitened and beside the model, shape (3 * points, p)."""
    return np.stack([projector.left(column) for column in np.moveaxis(columns, -1, 0)], axis=1)


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
    """Part of a displacement that lies in the span of columns."""
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not kept.size:
        return np.zeros_like(rest)
    Q, R, _ = qr(kept, mode="economic", pivoting=True)
    Q = Q[:, np.abs(np.diag(R)) > _SAME_COLUMN]
    return np.asarray(Q @ (Q.T @ rest))


def excess(
    scene: Scene,
    still: State,
    projector: Projector,
    seen: NDArray[np.bool_],
    visible: Array,
    faint: Array,
) -> float:
    """Mean squared distance by which held-out points are foretold wrongly, m^2, noise apart.

    visible : ndarray, shape (N, M, 3, p), m, instrument frame, what each parameter of the causes to be
        found moves; faint : ndarray, shape (N, M, 3), what all others do
    """
    columns = np.concatenate([modelled_columns(scene, still), _in_base(scene, visible)], axis=-1)
    unseen = _in_base(scene, faint[..., None])
    J, missed = projector.white(columns), projector.white(unseen)
    lengths = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    U, s, Vt = np.linalg.svd(J / lengths, full_matrices=False)
    kept = s > _SAME_COLUMN * s[0]
    back = (Vt[kept].T / s[kept]) / lengths[:, None]  # parameters from whitened readings along U
    held = seen & scene.session.held[:, None]
    G = columns[held] @ back
    bias = unseen[held] - G @ (U[:, kept].T @ missed)
    return float(np.mean(np.sum(G**2, axis=(-2, -1)) + np.sum(bias**2, axis=(-2, -1))))


def _in_base(scene: Scene, columns: Array) -> Array:
    """Columns (N, M, 3, p) of the instrument's frame in base axes."""
    return np.asarray(np.einsum("ji,nmjp->nmip", scene.R, columns))
