"""What an effect of the whole arm keeps of its parameters: those that pay for themselves.

Sag at every joint has dozens of products, of which the readings ask for a few. From the least worth on
they go one by one, as long as the sum of squares rises by less than Schwarz's price of one direction;
to first order the others follow by their covariance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.diagnosis.elimination import idle
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import ARM


def sparing(stage: Stage, fit: Fit) -> Fit:
    """A fit with such effects reduced to what pays; the fit itself where all of it does."""
    many = [e for e in fit.model.effects if e.where == ARM and len(e.parameters) > 1]
    asked = [i for e in many for i in fit.positions(e).tolist() if fit.span[i].any()]
    left_out = _idle(fit, asked)
    if not left_out:
        return fit
    kept = np.abs(fit.span[left_out]).sum(axis=0) == 0.0
    values = fit.values.copy()
    values[left_out] = 0.0
    return stage.along(replace(fit, values=values, span=fit.span[:, kept]))


def _idle(fit: Fit, asked: list[int]) -> list[int]:
    """Positions of parameters that may go."""
    if not asked:
        return []
    rows = int(np.count_nonzero(np.abs(fit.J).sum(axis=-1)))
    price = float(np.log(max(2, rows)))
    own = np.array(asked)
    gone, _ = idle(fit.values[own], fit.covariance[np.ix_(own, own)], price)
    return [int(i) for i in own[gone]]
