"""The noise of each of several instruments: a variance component for each.

One scale for all would take from a tracker as stated what a camera beside it errs too much. So each
instrument has its own by restricted likelihood (:mod:`calib.inference.reml`). The tip scatters beside
it at every pose: what the arm does, or its model lacks, moves all that rides on the tip as one, and is
no instrument's noise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.arrays import Array
from calib.identification.noise_level import REPLICATES, refuted
from calib.inference import Design, Marginal, Prior, RandomEffect
from calib.observations import Points
from calib.scatter import Scatter

_SAME = 0.05  # change of a scale that is not worth another fit: a thousandth of the deviations
_LEAST = 0.2  # nobody's instrument is five times better than its maker says


def noise_scales(points: Points, scatter: Scatter, r: Array, J: Array) -> Mapping[str, float]:
    """Actual over stated noise of those of several instruments that err by more or less than stated.

    points : Points, what was read; scatter : Scatter, of the same poses: how rows follow the tip
    r : ndarray, shape (m, R), whitened residuals of what was read, zero for what does not count
    J : ndarray, shape (m, R, k), what was fitted

    An instrument is judged where its rows have ten degrees of freedom beside all that, two-sided at one
    per cent. A single one is not asked: its noise has a level of its own.
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
    found = Marginal.fitted(design, Prior(instrument_least=_LEAST**2))
    squares = found.variances.instrument
    dof = 2.0 / np.diag(found.log_covariance)[: len(squares)]
    scales = {
        name: float(np.sqrt(square))
        for name, square, d in zip(names, squares, dof, strict=False)
        if d >= REPLICATES and refuted(float(d * square), round(float(d)))
    }
    return scales if any(abs(s - 1.0) >= _SAME for s in scales.values()) else {}
