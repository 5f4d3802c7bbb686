"""Where the arm's base stands in the instrument's frame, drawn at random."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_NEAR_HALF_A_TURN = 3.0  # rad: beyond, one placement has two rotation vectors


def placement(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation, shape (3, 3), and position, shape (3,), m, 2 to 5 m from the instrument."""
    while True:
        turn = Rotation.random(rng=rng)
        if turn.magnitude() < _NEAR_HALF_A_TURN:
            away = rng.normal(size=3)
            return turn.as_matrix(), rng.uniform(2.0, 5.0) * away / np.linalg.norm(away)
