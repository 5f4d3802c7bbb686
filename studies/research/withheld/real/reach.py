"""What the true causes leave of held-out readings once they are fitted to the data, in expectation.

The floor beside a model that is known exactly lies below: few poses leave parameters uncertain, and
causes too faint to be found stay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.actions import State
from studies.research.withheld.robots import Array
from studies.research.withheld.scene import Scene
from studies.research.withheld.visible import Projector, modelled_columns

_SAME = 1e-3  # relative size of a singular value below which a column is a sum of others


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
    kept = s > _SAME * s[0]
    back = (Vt[kept].T / s[kept]) / lengths[:, None]  # parameters from whitened readings along U
    held = seen & scene.session.held[:, None]
    G = columns[held] @ back
    bias = unseen[held] - G @ (U[:, kept].T @ missed)
    return float(np.mean(np.sum(G**2, axis=(-2, -1)) + np.sum(bias**2, axis=(-2, -1))))


def _in_base(scene: Scene, columns: Array) -> Array:
    """Columns (N, M, 3, p) of the instrument's frame in base axes."""
    return np.asarray(np.einsum("ji,nmjp->nmip", scene.R, columns))
