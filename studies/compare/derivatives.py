"""Whether the derivatives on which predictions rest are those of the model: central differences.

A derivative that is off by a factor leaves every minimum where it is; it spoils the covariance alone.
Simulation shows the difference, and so does noise that is too large for a linear fit: this tells them
apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.model import Model
from calib.poses import Poses

_MOVED_M = 1e-5  # by a step: far above where equilibria settle, far below where arms bend
_SEEN_M = 1e-6  # all points together: what moves them less is lost in how equilibria settle
WRONG = 1e-3
"""Share of a column beyond which it is no derivative; right ones keep to a few millionths."""


@dataclass(frozen=True)
class Derivatives:
    """The column of the Jacobian that is farthest from the model's own slope.

    off : float, length of the difference over that of the longer one; parameter : str, its id
    """

    off: float
    parameter: str

    @property
    def wrong(self) -> bool:
        """Whether the column is no derivative."""
        return not self.off < WRONG


def derivatives(model: Model, poses: Poses, *at: Array) -> Derivatives:
    """Compare the Jacobian at some values, each (p,), SI, with differences of the prediction."""
    worst = Derivatives(0.0, "")
    for values in at:
        _, J = model.jacobian(values, poses)
        step = _steps(model, J)
        ahead, back = (values + sign * np.diag(step) for sign in (1.0, -1.0))
        slope = np.moveaxis(model.predict(ahead, poses) - model.predict(back, poses), 0, -1)
        slope = (slope / (2.0 * step)).reshape(-1, len(step))
        columns = J.reshape(-1, len(step))
        size = np.maximum(np.linalg.norm(slope, axis=0), np.linalg.norm(columns, axis=0))
        moves = size * step > _SEEN_M
        off = np.linalg.norm(columns - slope, axis=0) / np.where(moves, size, np.inf)
        first = int(off.argmax())
        if not off[first] <= worst.off:
            worst = Derivatives(float(off[first]), model.parameters[first].id)
    return worst


def _steps(model: Model, J: Array) -> Array:
    """What moves a marker by a hundredth of a millimetre, a plausible size at most, shape (p,)."""
    moved = np.linalg.norm(J, axis=-2).max(axis=(0, 1))
    return np.asarray(np.minimum(model.sizes, _MOVED_M / np.maximum(moved, 1e-300)))
