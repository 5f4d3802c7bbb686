"""Normal priors that keep candidates near zero.

That of a single parameter is as wide as such errors are seldom larger on this arm. Curves, and causes
of several parameters, have one size each, which follows the data.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from calib.arrays import Array
from calib.diagnosis.curves import Curve
from calib.effects.protocol import Effect
from calib.effects.tuned import Tuned
from calib.model import Model

Amplitudes: TypeAlias = Mapping[Effect, float]
"""Size a priori of the parameters of a curve, or of a cause of several, in plausible sizes."""


def curves_in(model: Model) -> Iterator[tuple[Curve, slice]]:
    """The curves of a model, and where their coefficients stand."""
    yield from ((effect, part) for effect, part in model.parts if isinstance(effect, Curve))


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters of one common size.

    part : slice, where they stand; inverse : ndarray, shape (k, k), that makes them independent and of
        unit variance where the amplitude is one; largest : float, amplitude that is seldom met
    """

    effect: Effect
    part: slice
    inverse: Array
    largest: float


def blocks_in(model: Model) -> Iterator[Block]:
    """Curves, and causes by name of several parameters."""
    for effect, part in model.parts:
        sizes = np.array([p.size for p in effect.parameters])
        if isinstance(effect, Curve):
            root = np.linalg.cholesky(effect.spread) * sizes[0]
            yield Block(effect, part, np.linalg.inv(root), np.inf)
        elif effect.allowance is not None and len(sizes) > 1 and not isinstance(effect, Tuned):
            limits = effect.allowance * np.array([p.limit for p in effect.parameters])
            yield Block(effect, part, np.diag(1.0 / sizes), float((limits / sizes).max()))


def prior_rows(model: Model, amplitudes: Amplitudes) -> Array:
    """Rows of unit variance, shape (h, p): of causes one over their limits, of blocks by amplitude.

    Where no amplitude is known it is one.
    """
    limits = np.full(len(model.parameters), np.inf)
    for effect, part in model.parts:
        if effect.allowance is not None:
            limits[part] = effect.allowance * np.array([p.limit for p in effect.parameters])
    limits[model.tunings] = np.inf
    rows = []
    for block in blocks_in(model):
        own = np.zeros((len(block.inverse), len(model.parameters)))
        own[:, block.part] = block.inverse / amplitudes.get(block.effect, 1.0)
        limits[block.part] = np.inf
        rows.append(own)
    return np.concatenate([np.diag(1.0 / limits)[np.isfinite(limits)], *rows])
