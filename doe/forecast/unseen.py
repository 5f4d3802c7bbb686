"""The error at readings that a fit was without: held-out poses, or the ends of the day."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.noise import unwhitened
from calib.poses import Measurements
from calib.poses.moves import in_order
from calib.prediction.discrepancy import FittedModel

_ENDS = (1 / 3, 1 / 5, 1 / 10)  # of the readings; the largest that the others can do without
_SURELY = 2.33  # standard deviations: once in a hundred by chance


@dataclass(frozen=True)
class PredictionError:
    """3-D RMS per point, in the unit of the readings.

    rms : less the instrument's noise; lacking : less what the parameters' uncertainty adds there, too
    discrepancy : less the arm's scatter, too, zero where that may be chance; source : str, which poses
    certain : ``lacking``; where that may be chance, by the readings that the parameters leave certain
    """

    rms: float = 0.0
    lacking: float = 0.0
    discrepancy: float = 0.0
    certain: float = 0.0
    source: str = ""

    def times(self, factor: float) -> PredictionError:
        """The same figures in another unit of length."""
        rms, lacking = factor * self.rms, factor * self.lacking
        rest, certain = factor * self.discrepancy, factor * self.certain
        return PredictionError(rms, lacking, rest, certain, self.source)


def at_held_out(fit: FittedModel, heldout: Measurements) -> PredictionError:
    """The error at poses that the parameters never saw, at least one point of them seen."""
    return _error(fit, heldout, *fit.predicted(heldout), "held-out poses")


def at_ends(fit: FittedModel) -> PredictionError | None:
    """The error at the first and at the last readings, each predicted by all others; the worse counts.

    What drifts or warms up hides among readings of the same hours, and fresh poses come later. None
    where the others do not determine the model.
    """
    order, errors = in_order(fit.data.poses), list[PredictionError]()
    for way in (order, order[::-1]):
        ends = (np.sort(way[: round(part * len(way))]) for part in _ENDS)
        tried = (_at_end(fit, end) for end in ends if len(end))
        errors += [error for error in tried if error is not None][:1]
    return max(errors, key=lambda error: error.lacking, default=None)


def _at_end(fit: FittedModel, end: IntArray) -> PredictionError | None:
    """The error at some readings by a fit to the others; None where those do not determine it.

    A score test says whether it may be chance: where the parameters are uncertain tells little. Points
    of a pose err together: one counts.
    """
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
    size = max(float(fit.squared(data, off, spread).parameters.sum()), 1e-300)
    spread = spread * np.sqrt(rows.growth[1] * inside / size)

    error = _error(fit, data, off, spread, "the ends of the day")
    read, squares = data.seen[..., None] & fit.lengths, fit.squared(data, off, spread)
    seen, scatter = squares.seen, squares.arm
    if not (fit.sigma and seen.any()):
        return error
    each = np.sqrt(fit.sigma**2 + scatter / np.maximum(squares.numbers, 1))
    each = np.broadcast_to(each[..., None], read.shape)[read]
    together = float(seen.sum() / seen.any(axis=1).sum()) if scatter.any() else 1.0
    _, chance = _excess(off[read] / each, spread[read] / each[:, None], 1.0, together)
    beyond = 0.0 if chance else max(0.0, error.certain**2 - float(scatter[seen].mean()))
    return replace(error, lacking=error.certain, discrepancy=float(np.sqrt(beyond)))


def _error(
    fit: FittedModel, data: Measurements, off: Array, spread: Array, source: str
) -> PredictionError:
    """Of errors (m, C, r), m, where a fit was without, and the root of their covariance (.., k)."""
    squares = fit.squared(data, off, spread)
    if not squares.seen.any():
        return PredictionError(source=source)
    lacking = certain = squares.beyond(squares.noise + squares.parameters)
    read = data.seen[..., None] & fit.lengths
    excess, chance = _excess(off[read], spread[read], fit.sigma)
    if chance:
        certain = float(np.sqrt(max(0.0, excess) * read.sum() / squares.seen.sum()))
    rms = squares.beyond(squares.noise)
    return PredictionError(rms, lacking, squares.discrepancy, certain, source)


def _excess(off: Array, spread: Array, sigma: float, together: float = 1.0) -> tuple[float, bool]:
    """Variance of errors (n,) beyond ``V = sigma^2 I + spread spread^T``, and whether it may be chance.

    spread : ndarray, shape (n, k). One step of Fisher's scoring from none, and its score test: what
    the parameters leave uncertain counts little. together : so many errors are one
    """
    if not sigma:
        return float((off**2).mean()), False
    U, s, _ = np.linalg.svd(spread, full_matrices=False)
    own, v = (U.T @ off) ** 2, sigma**2 + s**2
    others, rest = len(off) - len(s), float(off @ off - own.sum())
    top = ((own - v) / v**2).sum() + (rest - others * sigma**2) / sigma**4
    bottom = (1.0 / v**2).sum() + others / sigma**4
    return float(top / bottom), bool(top < _SURELY * np.sqrt(2.0 * bottom * together))
