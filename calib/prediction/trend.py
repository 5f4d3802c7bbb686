"""The trend of the day: how far readings drift beside a fit, carried on to the targets' time.

A base or an instrument that settles or warms up moves all readings of a station as one rigid body. Each
of its six motions follows the clock by functions ``1 - exp(-t / tau)``, from soon settled to steady,
with normal coefficients of one common amplitude: a block of the mixed model. A fit without the block
stands where the day was on average. At another time it is off by the block there, less what its values
took up of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.effects.tool_base import Base
from calib.identification.scan import times
from calib.identification.variances import design_of
from calib.inference import GaussianBlock, Marginal, Prior, RandomEffect
from calib.prediction.discrepancy import FittedModel

_ODDS = 100.0  # to one: that there is a trend
_TAUS = np.array([0.25, 1.0, 1e3])  # of the session; the last one is a steady drift
_TYPICAL = 1e-4  # m and rad, of a drift in a day


def trend_of(fit: FittedModel, after: float = 0.0) -> Array | None:
    """Mean square (p, p), SI, of what the values are off by when the trend has gone on.

    after : s after the last reading
    None where no trend is shown, no time is given, or the model has one.
    """
    model, poses, own = fit.model, fit.data.poses, fit.model.where(Base)
    timed = any("time" in effect.uses for effect in model.effects)
    if timed or poses.time is None or not len(own) or not np.ptp(poses.clock):
        return None
    session = float(np.ptp(poses.clock))
    now, then = poses.clock - poses.clock.min(), np.array([session + after])
    rows = _TYPICAL * times(fit.linear.J[..., own], _functions(now / session))
    design, k = design_of(fit.linear, tuple(_scatter(fit))), rows.shape[-1]
    block = GaussianBlock("trend", rows, np.eye(k), np.zeros(k), None)
    alone = Marginal.fitted(design, Prior())
    found = Marginal.fitted(replace(design, blocks=(*design.blocks, block)), Prior())
    if found.log_likelihood - alone.log_likelihood < np.log(_ODDS):
        return None
    off = -fit.linear.followed(rows)
    off[own] += _TYPICAL * np.kron(_functions(then / session), np.eye(len(own)))
    mean, cov = found.posterior("trend")
    return np.asarray(off @ (np.outer(mean, mean) + cov) @ off.T)


def drift_words(moved_on: float, after: float | None) -> Iterator[str]:
    """What a trend does to the targets, and what to do; nothing without one.

    moved_on : float, m, RMS at the targets; after : s, None where nobody says when they come
    """
    if moved_on and after is None:
        yield (
            f"the readings drift, by {1e3 * moved_on:.3g} mm RMS at the end of the day: the error holds"
            " for then. Set [design] targets_after_h, or run `posecal diagnose`"
        )
    elif moved_on and after is not None:
        yield (
            f"the readings drift: by {1e3 * moved_on:.3g} mm RMS, {after / 3600.0:g} h after the last "
            "one. Run `posecal diagnose`, or measure when all is warm"
        )


def _functions(shares: Array) -> Array:
    """Each function at times (m,), shares of the session at whose end it is one, shape (m, K)."""
    return np.asarray(np.expm1(-shares[:, None] / _TAUS) / np.expm1(-1.0 / _TAUS))


def _scatter(fit: FittedModel) -> Iterator[RandomEffect]:
    """Scatter by approach and by configuration, in units of what was found."""
    scatter, v = fit.scatter, fit.scatter.variances
    levers = fit.points.rows(scatter.levers)
    for name, group, own in (
        ("approach", scatter.approach, v.approach),
        ("configuration", scatter.configuration, v.configuration),
    ):
        size = np.sqrt(own[scatter.kinds])
        if size.any():
            yield RandomEffect(name, (levers * size)[..., size > 0.0], name, group)
