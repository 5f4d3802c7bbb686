"""What keeps suspects near zero: normal priors, of curves of a size that follows the data.

Those of causes by name are as wide as such errors are seldom larger on this arm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calib.arrays import Array
from calib.diagnosis.curves import Curve
from calib.model import Model

_LEAST_FREE = 0.5  # coefficients that the data determine
_LEAST = 1e-9  # rad or m
_ROUNDS = 30
_SETTLED = 0.02


def curves_in(model: Model) -> Iterator[tuple[Curve, slice]]:
    """The curves of a model, and where their coefficients stand."""
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Curve):
            yield effect, part


def weak(model: Model) -> tuple[float, ...]:
    """Amplitudes at which the prior says next to nothing."""
    return tuple(effect.parameters[0].size for effect, _ in curves_in(model))


def prior_rows(model: Model, amplitudes: Sequence[float]) -> Array:
    """Rows of unit variance, shape (h, p): of causes one over their limits, of curves L^-1 / amplitude.

    ``L L^T`` is the curve's ``spread``.
    """
    limits = _limits(model)
    rows = [np.diag(1.0 / limits)[np.isfinite(limits)]]
    for (effect, part), amplitude in zip(curves_in(model), amplitudes, strict=True):
        own = np.zeros((part.stop - part.start, len(model.parameters)))
        own[:, part] = np.linalg.inv(np.linalg.cholesky(effect.spread)) / amplitude
        rows.append(own)
    return np.concatenate(rows)


def _limits(model: Model) -> Array:
    """Standard deviations a priori of what is suspected by name, shape (p,), infinite of all else."""
    found = np.full(len(model.parameters), np.inf)
    for effect, part in zip(model.effects, model.slices, strict=True):
        if effect.allowance is not None:
            found[part] = effect.allowance * np.array([p.limit for p in effect.parameters])
    found[model.tunings] = np.inf
    return found


def held_rows(
    model: Model, amplitudes: Sequence[float], values: Array, pull: float = 1.0
) -> tuple[Array, Array]:
    """Residuals (h,) and derivatives (h, p) of the prior, and of what is known beside the readings.

    pull : as of a fit, by which they weigh more
    """
    prior, (known, by_known) = prior_rows(model, amplitudes), model.beside(values)
    return (
        pull * np.concatenate([-prior @ values, known]),
        pull * np.concatenate([prior, by_known]),
    )


def fitted_amplitudes(
    model: Model, amplitudes: Sequence[float], J: Array, r: Array, span: Array
) -> tuple[float, ...]:
    """Amplitudes that the coefficients show (MacKay, Neural Computation 4(3), 1992, fixed point).

    J : ndarray, shape (N, p), r : ndarray, shape (N,), whitened data as a linear problem ``r = J v``
    span : ndarray, shape (p, k), directions that are estimated
    """
    found = np.array(amplitudes)
    if not len(found):
        return ()
    A, g = span.T @ (J.T @ J) @ span, span.T @ (J.T @ r)
    inverses = [np.linalg.inv(effect.spread) for effect, _ in curves_in(model)]
    parts = [part for _, part in curves_in(model)]
    for _ in range(_ROUNDS):
        held = prior_rows(model, found.tolist()) @ span
        half = span @ np.linalg.pinv(A + held.T @ held, hermitian=True)
        cov, values = half @ span.T, half @ g
        fresh = []
        for inverse, part, amplitude in zip(inverses, parts, found, strict=True):
            free = len(inverse) - float(np.trace(inverse @ cov[part, part])) / amplitude**2
            squared = float(values[part] @ inverse @ values[part]) / max(free, _LEAST_FREE)
            fresh.append(max(float(np.sqrt(squared)), _LEAST))
        settled = np.allclose(fresh, found, rtol=_SETTLED)
        found = np.array(fresh)
        if settled:
            break
    return tuple(found.tolist())
