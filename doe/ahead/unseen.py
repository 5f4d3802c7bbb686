"""The error at readings that a fit was without: held-out poses, or the ends of the day."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.noise import unwhitened
from calib.poses import Measurements
from calib.poses.moves import in_order
from calib.prediction.discrepancy import FittedModel

_ENDS = (1 / 3, 1 / 5, 1 / 10)  # of the readings; the largest that the others can do without


@dataclass(frozen=True)
class PredictionError:
    """3-D RMS per point, in the unit of the readings.

    rms : less the instrument's noise; lacking : less what the parameters' uncertainty adds there, too
    discrepancy : less the arm's scatter, too, zero where that may be chance; source : str, which poses
    """

    rms: float = 0.0
    lacking: float = 0.0
    discrepancy: float = 0.0
    source: str = ""

    def times(self, factor: float) -> PredictionError:
        """The same figures in another unit of length."""
        rms, lacking, discrepancy = (
            factor * own for own in (self.rms, self.lacking, self.discrepancy)
        )
        return PredictionError(rms, lacking, discrepancy, self.source)


def at_held_out(fit: FittedModel, heldout: Measurements) -> PredictionError:
    """The error at poses that the parameters never saw, at least one point of them seen."""
    return _error(fit, heldout, *fit.predicted(heldout), "held-out poses")


def at_ends(fit: FittedModel) -> PredictionError | None:
    """The error at the first and at the last readings, each predicted by all others; the worse counts.

    What drifts or warms up hides among readings of the same hours, and fresh poses come later. None
    where the others do not determine the model.
    """
    order, found = in_order(fit.data.poses), []
    for way in (order, order[::-1]):
        ends = (np.sort(way[: round(part * len(way))]) for part in _ENDS)
        errors = (_at_end(fit, end) for end in ends if len(end))
        found += [error for error in errors if error is not None][:1]
    return max(found, key=lambda error: error.lacking, default=None)


def _at_end(fit: FittedModel, end: IntArray) -> PredictionError | None:
    """The error at some readings by a fit to the others; None where those do not determine it."""
    member = np.isin(np.arange(len(fit.data)), end).astype(int)
    errors, rows = fit.left_out(member)
    if not rows.determined[1]:
        return None
    data, W, off = fit.data.take(end), fit.weights[end], errors[end]
    root = rows.spread.reshape(len(member), -1, rows.spread.shape[-1])[end]
    roots = (fit.data.in_place(column, end) for column in np.moveaxis(root, -1, 0))
    spread = np.stack([unwhitened(W, column) for column in roots], axis=-1)
    # As uncertain as the parameters are, which may follow poses that err as a whole.
    inside = fit.squared(data, *fit.predicted(data)).parameters.sum()
    own = max(float(fit.squared(data, off, spread).parameters.sum()), 1e-300)
    spread = spread * np.sqrt(rows.growth[1] * inside / own)
    return _error(fit, data, off, spread, "the ends of the day")


def _error(
    fit: FittedModel, data: Measurements, off: Array, spread: Array, source: str
) -> PredictionError:
    """Of errors (m, C, r), m, where a fit was without, and the root of their covariance (.., k)."""
    found = fit.squared(data, off, spread)
    if not found.seen.any():
        return PredictionError(source=source)
    return PredictionError(
        found.beyond(found.noise),
        found.beyond(found.noise + found.parameters),
        found.discrepancy,
        source,
    )
