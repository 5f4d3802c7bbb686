"""What is known of variances beforehand, as penalties on their logarithms.

The standard deviation s of an effect has a half-Cauchy prior with the scale A of its kind, from data
sheets (Gelman, Bayesian Analysis 1(3), 2006). The estimate is the mode of log s, so that it is never
zero (Chung, Rabe-Hesketh, Dorie, Gelman, Liu, Psychometrika 78(4), 2013):

    -2 log p(log s^2) = 2 log(1 + s^2 / A^2) - log s^2
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calib.arrays import Array
from calib.inference.design import Design


@dataclass(frozen=True, eq=False)
class Prior:
    """Priors of variances; kinds without a scale have none, and neither have amplitudes.

    scales : standard deviation of each kind of effect by data sheets, in the unit of the effect
    known : variance of each kind of effect that is not estimated
    of_logarithm : whether the estimate is the mode of log s, which is never zero, or that of s
    instrument_least : float, variance of an instrument that is believed at least
    """

    scales: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    instrument_least: float = 0.0
    of_logarithm: bool = True


@dataclass(frozen=True, eq=False)
class Penalty:
    """-2 log prior of log variances, its slope (t,) and its curvature (t,)."""

    value: float
    slope: Array
    curvature: Array

    @property
    def information(self) -> Array:
        """What the prior adds at the mode to the average information, shape (t,).

        The second derivative of a likelihood L by log s^2 is ``s^4 L'' + s^2 L'``, and at the mode L'
        opposes the slope of the prior.
        """
        return np.asarray(self.curvature + np.maximum(-self.slope, 0.0))


def penalty(design: Design, prior: Prior, theta: Array) -> Penalty:
    """Penalty of the variances theta (t,) of a design."""
    i, v = design.instruments, len(design.effects)
    slope, curvature, value = np.zeros(len(theta)), np.zeros(len(theta)), 0.0
    scales = effect_scales(design, prior)
    known = np.flatnonzero(np.isfinite(scales))
    own = theta[i : i + v][known]
    ratio = own / scales[known] ** 2
    value += float(2.0 * np.log1p(ratio).sum())
    slope[i + known] = 2.0 * ratio / (1.0 + ratio)
    if prior.of_logarithm:
        value -= float(np.log(np.maximum(ratio, 1e-300)).sum())
        slope[i + known] -= 1.0
    curvature[i + known] = 2.0 * ratio / (1.0 + ratio) ** 2
    return Penalty(value, slope, curvature)


def effect_scales(design: Design, prior: Prior) -> Array:
    """Scale of each effect, shape (v,), infinite without one."""
    return np.array([prior.scales.get(effect.kind, np.inf) for effect in design.effects])
