"""The noise of each of several instruments: a variance component for each.

One scale for all would take from a tracker as stated what a camera beside it errs too much. So each
instrument has its own by restricted likelihood, found as Helmert's and Förstner's variance component
estimation does (Koch, Parameter Estimation and Hypothesis Testing in Linear Models, 1999, 3.6): of the
residuals v of its whitened rows and their redundancies, ``s^2 = v^T v / sum(1 - h)``, the rows weighed
anew by it until nothing changes. The tip is free at every pose: what the arm does, or its model lacks,
moves all that rides on the tip as one, and is no instrument's noise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.identification.noise_level import REPLICATES, refuted
from calib.linear import orthonormal
from calib.observations import Points
from calib.scatter import Scatter

_SAME = 0.05  # change of a scale that is not worth another fit: a thousandth of the deviations
_ROUNDS = 30
_SETTLED = 1e-4
_LEAST = 0.2  # nobody's instrument is five times better than its maker says
_SHOWN = 1e-6  # of the largest: directions in which the tip moves no row


def noise_scales(points: Points, scatter: Scatter, r: Array, J: Array) -> Mapping[str, float]:
    """Actual over stated noise of those of several instruments that err by more or less than stated.

    points : Points, what was read; scatter : Scatter, of the same poses: how rows follow the tip
    r : ndarray, shape (m, R), whitened residuals of what was read, zero for what does not count
    J : ndarray, shape (m, R, k), what was fitted

    An instrument is judged where its rows have ten degrees of freedom beside all that, two-sided at one
    per cent. A single one is not asked: its noise has a level of its own.
    """
    channels, data = points.model.readout.channels, points.data
    count = len(channels.instruments)
    if count < 2:
        return {}
    levers = points.rows(scatter.levers[..., -6:])
    of_channel = np.repeat(np.arange(count), [p.stop - p.start for _, p in channels.blocks])
    of_row = np.repeat(of_channel[data.read], data.readings.shape[-1], axis=-1)
    counts: Mask = np.any(J, axis=-1)
    may: Mask = np.ones(count, dtype=bool)
    while True:
        scale, dof = _scales(of_row, r, J, levers, counts, may)
        told = np.array([d >= REPLICATES for d in dof])
        off = [refuted(float(d * s**2), round(d)) for s, d in zip(scale, dof, strict=True)]
        keep: Mask = np.logical_and(may, np.logical_and(told, off))
        if np.array_equal(keep, may):
            break
        may = keep
    if np.abs(scale - 1.0).max() < _SAME:
        return {}
    names = [instrument.name for instrument in channels.instruments]
    return {name: float(s) for name, s, own in zip(names, scale, may, strict=True) if own}


def _scales(
    of_row: IntArray, r: Array, J: Array, levers: Array, counts: Mask, may: Mask
) -> tuple[Array, Array]:
    """Scale of each instrument, one where it may not differ, and degrees of freedom, both (I,).

    of_row : ndarray of int, shape (m, R), the instrument
    """
    scale: Array = np.ones(len(may))
    dof: Array = np.zeros(len(may))
    for _ in range(_ROUNDS):
        by = 1.0 / scale[of_row]
        left, spare = _left(r * by, J * by[..., None], levers * by[..., None], counts)
        dof = np.asarray(np.bincount(of_row.ravel(), spare.ravel(), len(may)), dtype=float)
        squares = np.bincount(of_row.ravel(), left.ravel() ** 2, len(may))
        ratio = np.where(may & (dof >= REPLICATES), squares / np.maximum(dof, 1e-9), 1.0)
        fresh = np.maximum(scale * np.sqrt(ratio), _LEAST)
        settled, scale = np.abs(fresh - scale).max() < _SETTLED, fresh
        if settled:
            break
    return scale, dof


def _left(r: Array, J: Array, levers: Array, counts: Mask) -> tuple[Array, Array]:
    """Residuals and redundancies of rows, both (m, R), the tip free at every pose."""
    U, s, _ = np.linalg.svd(levers, full_matrices=False)
    U = U * (s > _SHOWN * s.max(axis=-1, keepdims=True))[:, None, :]
    Ut = np.swapaxes(U, -1, -2)
    r = r - (U @ (Ut @ r[..., None]))[..., 0]
    Q = orthonormal(stacked(J - U @ (Ut @ J)))
    left = r.ravel() - Q @ (Q.T @ r.ravel())
    taken = (U**2).sum(axis=-1) + (Q**2).sum(axis=-1).reshape(r.shape)
    return left.reshape(r.shape), np.where(counts, 1.0 - taken, 0.0)
