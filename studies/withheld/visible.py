"""How visible a cause is: the noncentrality of its displacement beside everything modelled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from studies.withheld.actions import Action, State
from studies.withheld.causes import Cause
from studies.withheld.robots import Array
from studies.withheld.scene import Scene
from studies.withheld.truth import Mechanism

_SAME = 1e-8  # relative size of a diagonal of R below which a column is a sum of others


def at_rest(scene: Scene, mechanism: Mechanism, causes: Sequence[Cause]) -> State:
    """The arm under the known loads and some causes."""

    def act(state: State) -> Action:
        action = scene.known(state)
        for cause in causes:
            cause.add_to(action, scene, state)
        return action

    return mechanism.rest(scene.session.q, act, (scene.R, scene.p))


def frame_columns(state: State, frame: int) -> Array:
    """D points / d twist of a frame, shape (N, M, 3, 6), base axes: what follows it moves rigidly."""
    R, arm = state.R[:, None, frame], state.points - state.o[:, None, frame]
    columns = np.empty((*state.points.shape, 6))
    columns[..., :3] = R
    for c in range(3):
        columns[..., 3 + c] = np.cross(R[..., c], arm)
    return columns


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
    """Takes out of a displacement what the user's model can take up.

    seen : ndarray of bool, shape (N, M), the points that the fit has
    """

    def __init__(self, scene: Scene, state: State, seen: NDArray[np.bool_]) -> None:
        self._seen = seen
        self._noise, self._points = scene.noise, state.readings[seen]
        # Columns stand in base axes, displacements in the instrument's.
        columns = np.swapaxes(modelled_columns(scene, state)[seen], -1, -2) @ scene.R.T
        J = np.swapaxes(self._noise.whitened(columns, self._points[:, None]), -1, -2)
        J = J.reshape(-1, J_width(scene))
        J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        Q, R, _ = qr(J, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(R))
        self._Q = Q[:, diagonal > _SAME * diagonal[0]]

    def left(self, moved: Array) -> Array:
        """What is left of readings moved by (N, M, 3), m, whitened, shape (3 * points,)."""
        r = self._noise.whitened(moved[self._seen], self._points).ravel()
        rest: Array = r - self._Q @ (self._Q.T @ r)
        return rest


def J_width(scene: Scene) -> int:
    """Number of columns before reduction."""
    frames = 1 if scene.known_geometry else scene.arm.dof + 2
    return 6 * frames + 3 * len(scene.markers) + len(scene.modelled)


def given(rest: Array, other: Array) -> float:
    """Noncentrality of one displacement beside another, both projected."""
    size = float(other @ other)
    along = float(rest @ other) / size if size > 0.0 else 0.0
    beside = rest - along * other
    return float(beside @ beside)
