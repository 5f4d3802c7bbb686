"""What keeps the coefficients of curves near zero: a normal prior whose size follows the data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calib.diagnosis.curves import Curve
from calib.model import Model
from calib.se3 import Array

_LEAST_FREE = 0.5  # coefficients that the data determine
_LEAST = 1e-9  # rad or m


def curves_in(model: Model) -> Iterator[tuple[Curve, slice]]:
    """The curves of a model, and where their coefficients stand."""
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Curve):
            yield effect, part


def weak(model: Model) -> tuple[float, ...]:
    """Amplitudes at which the prior says next to nothing."""
    return tuple(effect.parameters[0].size for effect, _ in curves_in(model))


def prior_rows(model: Model, amplitudes: Sequence[float]) -> Array:
    """Rows ``L^-1 / amplitude`` of unit variance, shape (h, p), ``L L^T`` the curve's ``spread``."""
    rows = [np.zeros((0, len(model.parameters)))]
    for (effect, part), amplitude in zip(curves_in(model), amplitudes, strict=True):
        own = np.zeros((part.stop - part.start, len(model.parameters)))
        own[:, part] = np.linalg.inv(np.linalg.cholesky(effect.spread)) / amplitude
        rows.append(own)
    return np.concatenate(rows)


def updated(
    model: Model, amplitudes: Sequence[float], values: Array, cov: Array
) -> tuple[float, ...]:
    """Amplitudes that the coefficients show (MacKay, Neural Computation 4(3), 1992, fixed point).

    values : ndarray, shape (p,); cov : ndarray, shape (p, p), of the fit at the present amplitudes
    """
    found = []
    for (effect, part), amplitude in zip(curves_in(model), amplitudes, strict=True):
        inverse = np.linalg.inv(effect.spread)
        determined = len(inverse) - float(np.trace(inverse @ cov[part, part])) / amplitude**2
        squared = float(values[part] @ inverse @ values[part]) / max(determined, _LEAST_FREE)
        found.append(max(float(np.sqrt(squared)), _LEAST))
    return tuple(found)
