"""Whether anything changed, and which parameters: false alarms held over all of them together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.change.difference import Difference

FALSE_ALARM = 0.02
"""How often anything is said to have changed where nothing has."""

GROWN = 0.005
"""How often a later fit is said to leave more where it does not."""


@dataclass(frozen=True, eq=False)
class Moved:
    """What the difference says against "nothing changed".

    statistic : float, the squared difference in its standard deviations, over the n rows that count
    rows : int, n; p_value : float, of so large a one by chance
    std : ndarray, shape (k,), SI, of each difference; NaN where a day does not determine it
    grown : float, p value of what the later fit leaves more
    family_p : ndarray, shape (k,), by Holm's step-down over all parameters (Scand. J. Statist. 6, 1979)
    """

    statistic: float
    rows: int
    p_value: float
    std: Array
    family_p: Array
    grown: float

    @property
    def anything(self) -> bool:
        """Whether something changed."""
        return self.p_value < FALSE_ALARM

    @property
    def beyond(self) -> bool:
        """Whether the later fit leaves surely more: something came up that the model lacks."""
        return self.grown < GROWN

    @property
    def parameters(self) -> Mask:
        """Which parameters did, shape (k,), named only where something changed at all."""
        return np.asarray(self.anything & (self.family_p < FALSE_ALARM))


def moved(found: Difference) -> Moved:
    """Test all parameters together, then each."""
    from scipy.special import stdtr

    y = found.whitened
    std = np.where(found.determined, np.sqrt(np.maximum(np.diag(found.covariance), 0.0)), np.nan)
    ratio = np.abs(found.change) / std
    single = 2.0 * stdtr(min(found.dof, 1e9), -ratio)
    statistic = float(y @ y)
    return Moved(
        statistic, len(y), tail(statistic, len(y), found.dof), std, holm(single), found.grown
    )


def tail(statistic: float, rows: int, dof: float) -> float:
    """Probability of a larger sum of squares of so many rows, whose unit has dof degrees of freedom."""
    from scipy.special import chdtrc, fdtrc

    if not rows:
        return 1.0
    if dof > 1e8:
        return float(chdtrc(rows, statistic))
    return float(fdtrc(rows, dof, statistic / rows))


def holm(p: Array) -> Array:
    """P values that hold over the family, shape (k,); NaN is no member."""
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known])]
    stepped = np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1))
    out = np.full(len(p), np.nan)
    out[order] = np.minimum(stepped, 1.0)
    return out
