"""Chi-square tests of a prediction by simulated trials.

With errors e of T trials, their mean m and the predicted covariance C of rank k, chi-square are: the
scatter ``sum (e - m)^T C^-1 (e - m)`` with (T - 1) k degrees of freedom, the same for each parameter
alone with T - 1, and the bias ``T m^T C^-1 m`` with k. What the fits leave over, weighted by the noise,
is chi-square too: a model that the readings do not come from leaves more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array

_RANK = 1e-9  # eigenvalue of the correlation matrix below which a direction is fixed
BELIEVED = 0.01
"""Probability below which the prediction counts as refuted."""
FEWEST = 20
"""Trials below which nothing is said of the prediction."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Simulated over predicted.

    trials : int; std : ndarray, shape (p,), SI, of the trials about their own mean
    bias : ndarray, shape (p,), SI, mean error; NaN in both where a parameter is open
    ratio : ndarray, shape (p,), simulated over predicted standard deviation
    total : float, scatter over its expectation
    shift : float, length of the mean error in standard deviations, per direction
    left : float, weighted squares that the fits leave over their expectation, NaN where not asked
    tests : dict, "scatter", "bias", "parameter", "left" -> probability of as much by chance
    """

    trials: int
    std: Array
    bias: Array
    ratio: Array
    total: float
    shift: float
    left: float
    tests: dict[str, float]

    @property
    def p(self) -> float:
        """Probability of so large a disagreement by chance, over all tests made (Bonferroni)."""
        return min(1.0, len(self.tests) * min(self.tests.values()))

    @property
    def worst_ratio(self) -> float:
        """The ratio farthest from one."""
        known = self.ratio[np.isfinite(self.ratio)]
        return float(known[np.abs(np.log(known)).argmax()]) if len(known) else float("nan")

    @property
    def bias_share(self) -> Array:
        """Bias in standard errors of the simulated mean, shape (p,)."""
        return np.asarray(self.bias / (self.std / np.sqrt(self.trials)))


def agreement(
    errors: Array, covariance: Array, cost: Array | None = None, spare: int = 0
) -> Agreement | None:
    """Judge trials by a predicted covariance; None from fewer than two.

    errors : ndarray, shape (trials, p), SI; covariance : ndarray, shape (p, p), SI
    cost : ndarray, shape (trials,), what each fit leaves in squared standard deviations, with ``spare``
        degrees of freedom each; left out of the tests without
    """
    from scipy.special import chdtrc

    trials = len(errors)
    variance = np.diag(covariance)
    known = variance > 0.0
    if trials < 2 or not known.any():
        return None
    predicted = np.where(known, np.sqrt(variance), np.nan)
    std = np.where(known, errors.std(axis=0, ddof=1), np.nan)
    scaled = errors[:, known] / predicted[known]
    values, vectors = np.linalg.eigh(
        covariance[np.ix_(known, known)] / np.outer(*[predicted[known]] * 2)
    )
    free = values > _RANK
    whitened = scaled @ vectors[:, free] / np.sqrt(values[free])
    mean, k = whitened.mean(axis=0), whitened.shape[1]
    scatter, dof = float(((whitened - mean) ** 2).sum()), (trials - 1) * k
    alone = [_two_sided((trials - 1) * v, trials - 1) for v in scaled.var(axis=0, ddof=1)]
    bias = float(chdtrc(k, trials * (mean**2).sum()))
    tests = {
        "scatter": _two_sided(scatter, dof),
        "bias": bias,
        "parameter": len(alone) * min(alone),
    }
    left = float("nan")
    if cost is not None and spare > 0:
        left = float(cost.sum()) / (trials * spare)
        tests["left"] = _two_sided(float(cost.sum()), trials * spare)
    return Agreement(
        trials,
        std,
        np.where(known, errors.mean(axis=0), np.nan),
        std / predicted,
        scatter / dof,
        float(np.sqrt((mean**2).sum() / k)),
        left,
        tests,
    )


def band(trials: int, level: float = 0.95) -> tuple[float, float]:
    """Where the ratio of standard deviations lies by chance with a probability."""
    from scipy.special import chdtri

    tail = (1.0 - level) / 2.0
    dof = trials - 1
    low, high = (float(np.sqrt(chdtri(dof, q) / dof)) for q in (1.0 - tail, tail))
    return low, high


def _two_sided(value: float, dof: int) -> float:
    """Probability of a chi-square as far from its expectation, on either side."""
    from scipy.special import chdtr, chdtrc

    return 2.0 * min(float(chdtr(dof, value)), float(chdtrc(dof, value)))
