"""One robust rule: poses that the others contradict weigh less, and none is dropped.

Up to a quantile c of the statistic q that one pose in a thousand exceeds, a pose of n rows has weight
one, so that clean rows keep the plain estimate. Beyond, ``w^2 q = n + (c - n) (c / q)^2`` falls from c
to n, what any pose is expected to add to the sum of squares: gross errors raise no variance. Before
they lose their weight they inflate all variances, and a model that lacks something inflates all
statistics, so these count in units of their median.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.inference.design import Design, Variances
from calib.inference.marginal import Marginal
from calib.inference.prior import Prior
from calib.inference.reml import reml
from calib.inference.tails import chi_square_quantile

_RARE = 1e-3  # of the poses without gross error weigh less than one
_FEWEST = 8  # poses below which a median means little
_ROUNDS = 8
_SETTLED = 0.01


def pose_weights(statistic: Array, rows: IntArray) -> Array:
    """Weights of poses, shape (m,), as factors of their rows; zero for poses without rows.

    statistic, rows : ndarray, shape (m,), as of :meth:`Marginal.pose_statistics`
    """
    used = rows > 0
    freedom = np.maximum(rows, 1).astype(np.float64)
    ratio = statistic[used] / chi_square_quantile(0.5, freedom[used])
    typical = float(np.median(ratio)) if len(ratio) >= _FEWEST else 1.0
    q = statistic / max(typical, 1e-300)
    cut = chi_square_quantile(1.0 - _RARE, freedom)
    q = np.maximum(q, cut)
    weight = np.sqrt((freedom + (cut - freedom) * (cut / q) ** 2) / q)
    return np.asarray(np.where(used, weight, 0.0))


def robust_reml(
    design: Design, prior: Prior | None = None, start: Variances | None = None
) -> tuple[Design, Variances]:
    """The design with robust weights, and its variances, found in turn until the weights settle.

    Poses of weight zero stay out.
    """
    taken = design.pose_weight > 0.0
    for _ in range(_ROUNDS):
        start = reml(design, prior, start)
        statistic, rows = Marginal.at(design, start, prior).pose_statistics()
        weight = np.where(taken, np.where(rows > 0, pose_weights(statistic, rows), 1.0), 0.0)
        settled = np.abs(weight - design.pose_weight).max(initial=0.0) < _SETTLED
        design = replace(design, pose_weight=weight)
        if settled:
            break
    return design, reml(design, prior, start)
