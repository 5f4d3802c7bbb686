"""The noise of the readings: its level, the scale of each of several instruments, what repeats say.

The level is the cell's where nothing refutes it, else that of repeated readings, else the residual's.
Of several instruments each has a variance component: one scale for all would take from a tracker as
stated what a camera beside it errs too much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size
from calib.identification.variances import LEAST_INSTRUMENT, VarianceEstimate
from calib.inference import Design, Marginal, Prior, RandomEffect
from calib.model.readout import Readout
from calib.noise import counted
from calib.observations import Points
from calib.observations.scatter import Scatter
from calib.poses import Measurements
from calib.poses.moves import visits

_DISAGREE = 0.01  # p value at which two estimates of the noise are taken to differ
_REPLICATES = 10  # degrees of freedom of an estimate worth using
_GROSS = 10.0  # times the mean square of a typical group of repeats
_SAME = 0.05  # change of a scale that is not worth another fit: a thousandth of the deviations
_SILENT = 1e-9

Source = Literal["cell", "replicates", "residual"]


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviation of one coordinate.

    believed : float, m, root mean square of what the cell says for the points measured
    factor : float, actual over believed noise; source : where it comes from
    dof : float, degrees of freedom behind the factor, infinite for the cell's
    replicate_factor : float or None, what repeated readings alone say
    lack_of_fit_p : float, probability of so large a residual under the noise before it was widened
    stated : float, m, what the cell says; believed is another where one of several instruments has a
        scale (:func:`noise_scales`)
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
    spread, repeats = map(float, _spreads(data, weights, data.poses.repeated).sum(axis=0))
    factor, known = 1.0, np.inf
    source: Source = "cell"
    # Noise never repeats to the digit: repeats without any spread are copies and say nothing.
    by_repeats = float(np.sqrt(spread / repeats)) if repeats >= _REPLICATES and spread else None
    if by_repeats is not None and refuted(spread, int(repeats)):
        factor, source, known = by_repeats, "replicates", repeats
    below, p_fit = _chances(cost / factor**2, dof, known)
    if 2.0 * min(below, p_fit) < _DISAGREE:
        factor, source, known = float(np.sqrt(cost / dof)), "residual", float(dof)
    return NoiseLevel(believed, factor, source, known, by_repeats, p_fit, stated)


def of_levels(levels: VarianceEstimate, alone: NoiseLevel) -> NoiseLevel:
    """The instrument's noise beside the scatter of the arm; ``alone``: that of the whole residual."""
    source: Source = "replicates" if levels.estimated else "cell"
    if levels.variances.configuration.any():
        source = "residual"
    # Where nothing separates the instrument from the arm, both rest on the residual.
    dof = float(levels.instrument_rows) if levels.instrument_seen else alone.dof
    dof = dof if levels.scale_estimated else np.inf
    return replace(alone, factor=levels.variances.scale, source=source, dof=dof)


def believed_sigma(data: Measurements, weights: Array, lengths: Mask) -> float:
    """Root mean square over the readings of the standard deviation of a number: of a coordinate, m.

    weights : ndarray, shape (m, C, r, r), whitening matrices
    lengths : ndarray of bool, shape (C, r), which numbers count
    """
    seen = weights[data.seen]
    of = np.broadcast_to(lengths, (*data.seen.shape, lengths.shape[-1]))[data.seen]
    of = of & seen.any(axis=-2)
    squares = (np.linalg.pinv(seen) ** 2).sum(axis=-1) * of
    return float(np.sqrt(squares.sum() / max(of.sum(), 1)))


def refuted(cost: float, dof: int) -> bool:
    """Whether a sum of squares of so many degrees of freedom is no chi-square."""
    return 2.0 * min(_chances(cost, dof, np.inf)) < _DISAGREE


def _chances(cost: float, dof: int, known: float) -> tuple[float, float]:
    """Chances of a smaller and of a larger sum of squares, in noise of so many degrees of freedom."""
    from scipy.special import chdtr, chdtrc, fdtr, fdtrc

    if dof <= 0:
        return 1.0, 1.0
    if np.isinf(known):
        return float(chdtr(dof, cost)), float(chdtrc(dof, cost))
    return float(fdtr(dof, known, cost / dof)), float(fdtrc(dof, known, cost / dof))


def replicate_factor(data: Measurements, weights: Array) -> float:
    """Actual over stated noise by readings repeated without a move; one where they agree or are few.

    Readings between which the arm moved hold its repeatability as well. A group with a gross error
    stands out among the others and does not count.
    """
    stays = np.column_stack([data.poses.repeated, visits(data.poses)])
    spreads = _spreads(data, weights, np.unique(stays, axis=0, return_inverse=True)[1].reshape(-1))
    spreads = spreads[spreads[:, 1] > 0]
    if not len(spreads):
        return 1.0
    squares = spreads[:, 0] / spreads[:, 1]
    typical = np.quantile(squares, 0.25, method="lower")
    spread, dof = map(float, spreads[squares <= _GROSS * typical].sum(axis=0))
    known = dof >= _REPLICATES and spread and refuted(spread, int(dof))
    return float(np.sqrt(spread / dof)) if known else 1.0


def _spreads(data: Measurements, weights: Array, group: IntArray) -> Array:
    """Weighted sum of squares and degrees of freedom of each group (m,) of repeats, shape (.., 2)."""
    spreads = [np.zeros((0, 2))]
    for index in by_size(group):
        if index.shape[1] < 2:
            continue
        seen, W = data.seen[index][..., None], weights[index]
        count = seen.sum(axis=1, keepdims=True)
        mean = (data.readings[index] * seen).sum(axis=1, keepdims=True) / np.maximum(count, 1)
        deviation = W @ ((data.readings[index] - mean) * seen)[..., None]
        spare = np.maximum(count[:, 0, :, 0] - 1, 0)
        dof = (counted(W).max(axis=1) * spare).sum(axis=1)
        spreads.append(np.column_stack([(deviation**2).sum(axis=(1, 2, 3, 4)), dof]))
    return np.concatenate(spreads)


def noise_scales(points: Points, scatter: Scatter, r: Array, J: Array) -> Mapping[str, float]:
    """Actual over stated noise of those of several instruments that err by more or less than stated.

    scatter : Scatter, of the same poses: how rows follow the tip
    r, J : ndarrays, shapes (m, R) and (m, R, k), whitened residuals, and what was fitted

    The tip scatters beside them at every pose: what the arm does, or its model lacks, moves all that
    rides on it as one. An instrument is judged where its rows have ten degrees of freedom.
    """
    channels, data = points.model.readout.channels, points.data
    names = [instrument.name for instrument in channels.instruments]
    if len(names) < 2:
        return {}
    of_channel = np.repeat(np.arange(len(names)), [p.stop - p.start for _, p in channels.blocks])
    of_row = np.repeat(of_channel[data.read], data.readings.shape[-1], axis=-1)
    levers, each = points.rows(scatter.levers[..., -6:]), np.arange(len(r))
    tip = [RandomEffect(str(a), levers[..., a : a + 3], str(a), each) for a in (0, 3)]
    present = np.where(np.any(J, axis=-1), of_row, -1)
    design = Design(r, J, np.eye(J.shape[-1]), (), tuple(tip), present)
    fitted = Marginal.fitted(design, Prior(instrument_least=LEAST_INSTRUMENT))
    squares = fitted.variances.instrument
    dof = 2.0 / np.diag(fitted.log_covariance)[: len(squares)]
    scales = {
        name: float(np.sqrt(square))
        for name, square, d in zip(names, squares, dof, strict=False)
        if d >= _REPLICATES and refuted(float(d * square), round(float(d)))
    }
    return scales if any(abs(s - 1.0) >= _SAME for s in scales.values()) else {}
