"""The proof of how good a plan is, from an information matrix alone.

For any positive definite M the supergradient G of the criterion there bounds every plan:
``Phi <= <G, M_fixed> + max over plans of sum <G, M_i>``. Nothing is assumed of where M came from, so a
solver's inaccuracy can make the bound loose but never wrong.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks


def bound(G: Array, blocks: Blocks, allowed: Allowed) -> float:
    """No allowed plan has a larger criterion than this, G, shape (p, p), being a supergradient."""
    return float((G * blocks.fixed).sum()) + allowed.best(blocks.scores(G))[0]


def survivors(G: Array, blocks: Blocks, allowed: Allowed, value: float) -> np.ndarray:
    """Positions of candidates that a plan better than ``value`` may contain (reduced-cost fixing).

    G : ndarray, shape (p, p), supergradient of the criterion
    """
    reachable = float((G * blocks.fixed).sum()) + allowed.forced(blocks.scores(G))
    return np.flatnonzero(reachable > value)
