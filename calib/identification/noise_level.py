"""Which standard deviation the covariance should be built on: the cell's, repeats', residual's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size
from calib.model.readout import Readout
from calib.noise import counted
from calib.poses import Measurements
from calib.poses.moves import visits
from calib.scatter import VarianceEstimate

_DISAGREE = 0.01  # p value at which two estimates of the noise are taken to differ
_SILENT = 1e-9
_GROSS = 10.0  # times the mean square of a typical group of repeats
REPLICATES = 10  # degrees of freedom of a repeat estimate worth using

Source = Literal["cell", "replicates", "residual"]


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviation of one coordinate.

    believed : float, m, root mean square of what the cell says for the points measured
    factor : float, actual over believed
    source : where the factor comes from
    dof : float, degrees of freedom behind the factor, infinite for the cell's
    replicate_factor : float or None, what repeated readings alone say
    lack_of_fit_p : float, probability of so large a residual under the noise before it was widened
    stated : float, m, what the cell says; believed is another where an instrument beside others turned
        out to be noisier or less noisy than stated (:mod:`calib.identification.noise_scales`)
    """

    believed: float
    factor: float
    source: Source
    dof: float
    replicate_factor: float | None
    lack_of_fit_p: float
    stated: float

    @property
    def sigma(self) -> float:
        """Standard deviation of one coordinate [m] on which the covariance is built."""
        return self.believed * self.factor

    @property
    def divisor(self) -> float:
        """The factor; where copies scatter by nothing, hardly more than that."""
        return max(self.factor, _SILENT)


def of_levels(levels: VarianceEstimate, alone: NoiseLevel) -> NoiseLevel:
    """The instrument's noise where the arm scatters beside it.

    alone : that of a residual which the levels have made one
    """
    source: Source = "cell"
    if levels.variances.configuration.any():
        source = "residual"
    elif levels.estimated:
        source = "replicates"
    dof = float("inf")
    if levels.scale_estimated:
        # Where nothing tells the instrument from the arm, both rest on the residual.
        dof = float(levels.instrument_rows) if levels.instrument_seen else alone.dof
    return replace(alone, factor=levels.variances.scale, source=source, dof=dof)


def believed_sigma(data: Measurements, weights: Array, lengths: Mask) -> float:
    """Root mean square over the readings of the standard deviation of a number: of a coordinate, m.

    weights : ndarray, shape (m, C, r, r), whitening matrices
    lengths : ndarray of bool, shape (C, r), which numbers count
    """
    own = weights[data.seen]
    of = np.broadcast_to(lengths, (*data.seen.shape, lengths.shape[-1]))[data.seen]
    of = of & own.any(axis=-2)
    squares = (np.linalg.pinv(own) ** 2).sum(axis=-1) * of
    return float(np.sqrt(squares.sum() / max(of.sum(), 1)))


def replicate_spread(data: Measurements, weights: Array) -> tuple[float, int]:
    """Weighted sum of squares within repeated readings, and its degrees of freedom.

    weights : ndarray, shape (m, C, r, r), whitening matrices
    """
    spread, dof = replicate_spreads(data, weights, data.poses.repeated).sum(axis=0)
    return float(spread), int(dof)


def replicate_spreads(data: Measurements, weights: Array, group: IntArray) -> Array:
    """Weighted sum of squares and degrees of freedom of each group of repeats, shape (.., 2).

    group : ndarray of int, shape (m,), of each reading
    """
    found = [np.zeros((0, 2))]
    for index in by_size(group):
        if index.shape[1] < 2:
            continue
        seen, own = data.seen[index][..., None], weights[index]
        count = seen.sum(axis=1, keepdims=True)
        mean = (data.readings[index] * seen).sum(axis=1, keepdims=True) / np.maximum(count, 1)
        deviation = own @ ((data.readings[index] - mean) * seen)[..., None]
        spare = np.maximum(count[:, 0, :, 0] - 1, 0)
        dof = (counted(own).max(axis=1) * spare).sum(axis=1)
        found.append(np.column_stack([(deviation**2).sum(axis=(1, 2, 3, 4)), dof]))
    return np.concatenate(found)


def replicate_factor(data: Measurements, weights: Array) -> float:
    """Actual over stated noise by readings repeated without a move; one where they agree.

    One too where they are few. Readings between which the arm moved hold its repeatability as well.
    Groups with a gross error do not count: whatever is no noise stands out among the others.
    """
    _, group = np.unique(
        np.column_stack([data.poses.repeated, visits(data.poses)]), axis=0, return_inverse=True
    )
    spreads = replicate_spreads(data, weights, group.reshape(-1))
    spreads = spreads[spreads[:, 1] > 0]
    if not len(spreads):
        return 1.0
    squares = spreads[:, 0] / spreads[:, 1]
    typical = np.quantile(squares, 0.25, method="lower")
    spread, dof = spreads[squares <= _GROSS * typical].sum(axis=0)
    if dof < REPLICATES or not spread:  # without any spread they are copies
        return 1.0
    return float(np.sqrt(spread / dof)) if refuted(float(spread), int(dof)) else 1.0


def refuted(cost: float, dof: int) -> bool:
    """Whether a sum of squares of so many degrees of freedom is no chi-square."""
    return 2.0 * min(_chances(cost, dof, np.inf)) < _DISAGREE


def noise_level(
    cost: float, dof: int, data: Measurements, weights: Array, readout: Readout
) -> NoiseLevel:
    """Decide by chi-square and F tests which source to trust, two-sided at one per cent.

    cost, dof : sum of squared whitened residuals of the kept poses, and degrees of freedom
    weights : ndarray, shape (m, C, r, r), whitening matrices, by the noise scales of the readout
    """
    lengths = readout.channels.lengths
    believed = stated = believed_sigma(data, weights, lengths)
    if scales := readout.noise_scales:
        back = readout.rescaled(weights, {name: 1.0 / s for name, s in scales.items()})
        stated = believed_sigma(data, back, lengths)
    spread, repeats = replicate_spread(data, weights)
    factor, known = 1.0, np.inf
    source: Source = "cell"
    # Noise never repeats to the digit: repeats without any spread are copies and say nothing.
    own = float(np.sqrt(spread / repeats)) if repeats >= REPLICATES and spread > 0.0 else None
    if own is not None and refuted(spread, repeats):
        factor, source, known = own, "replicates", float(repeats)
    below, p_fit = _chances(cost / factor**2, dof, known)
    if 2.0 * min(below, p_fit) < _DISAGREE:
        factor, source, known = float(np.sqrt(cost / dof)), "residual", float(dof)
    return NoiseLevel(believed, factor, source, known, own, p_fit, stated)


def _chances(cost: float, dof: int, known: float) -> tuple[float, float]:
    """Chances of a smaller and of a larger sum of squares, in noise of so many degrees of freedom."""
    from scipy.special import chdtr, chdtrc, fdtr, fdtrc

    if dof <= 0:
        return 1.0, 1.0
    if np.isinf(known):
        return float(chdtr(dof, cost)), float(chdtrc(dof, cost))
    return float(fdtr(dof, known, cost / dof)), float(fdtrc(dof, known, cost / dof))
