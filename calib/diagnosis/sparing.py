"""What an effect of the whole arm keeps of its parameters: those that pay for themselves.

Sag at every joint has dozens of products, of which the readings ask for a few. From the least worth on
they go one by one, as long as the sum of squares rises by less than Schwarz's price of one direction;
to first order the others follow by their covariance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import ARM
from calib.se3 import Array


def sparing(stage: Stage, fit: Fit) -> Fit:
    """A fit with such effects reduced to what pays; the fit itself where all of it does."""
    many = [e for e in fit.model.effects if e.where == ARM and len(e.parameters) > 1]
    asked = [i for e in many for i in fit.positions(e).tolist() if fit.span[i].any()]
    idle = _idle(fit, asked)
    if not idle:
        return fit
    kept = np.abs(fit.span[idle]).sum(axis=0) == 0.0
    values = fit.values.copy()
    values[idle] = 0.0
    return stage.along(replace(fit, values=values, span=fit.span[:, kept]))


def _idle(fit: Fit, asked: list[int]) -> list[int]:
    """Positions of parameters that may go."""
    if not asked:
        return []
    rows = int(np.count_nonzero(np.abs(fit.J).sum(axis=-1)))
    price = float(np.log(max(2, rows)))
    own = np.array(asked)
    cov: Array = fit.covariance[np.ix_(own, own)]
    values = fit.values[own]
    gone: list[int] = []
    while len(gone) < len(own):
        left = np.setdiff1d(np.arange(len(own)), gone)
        worth = values[left] ** 2 / np.maximum(np.diag(cov)[left], 1e-300)
        first = int(np.argmin(worth))
        i = int(left[first])
        if float(worth[first]) >= price:
            break
        share = cov[:, i] / cov[i, i]
        values = values - share * values[i]
        cov = cov - np.outer(share, cov[i])
        gone.append(i)
    return [int(own[i]) for i in gone]
