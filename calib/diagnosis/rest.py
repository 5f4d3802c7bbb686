"""What remains once every cause that was found is in the model: how large it is, and what it is like.

Sizes are standard deviations of one coordinate of a measured point, beyond the instrument's. What
differs from pose to pose and follows no column is scatter as long as it is no larger than the arm's
repeatability: as the cell states it, as second approaches show it, or else as arms of this size have
it by their data sheets.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Literal

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise_level import NoiseLevel

Kind = Literal["none", "scatter", "structure", "too_large"]
Whose = Literal["instrument", "arm", "model", "undecided"]
Source = Literal["stated", "measured", "assumed"]

_NO_LARGER = 1.25  # times the repeatability: both are estimates
_COORDINATES = 3  # of the tip that an approach shows
_BLUNDERS = 0.05  # of the poses: more that were left out are none


@dataclass(frozen=True)
class Rest:
    """What remains.

    size : float, m; of : whose it is
    repeatability : float, m, of the arm by this source, against which it is held
    """

    size: float
    kind: Kind
    of: Whose
    repeatability: float
    source: Source

    @property
    def closed(self) -> bool:
        """Whether it is nothing, or what such an arm scatters by anyway."""
        return self.kind in ("none", "scatter")


def rest_of(
    stage: Stage, fit: Fit, noise: NoiseLevel, structure: bool, more: float | None = None
) -> Rest:
    """What a fit leaves.

    noise : of the instrument beside it; structure : whether a part of what remains has a place
    more : float, m, what held-out poses err by beyond all that is expected; None where not surely more
    """
    each = (fit.variances.approach, fit.variances.configuration)
    again, fixed = (_size(stage, v) for v in each)
    fixed = hypot(fixed, more or 0.0)
    if stage.arm is not None:
        return _judged(again, fixed, again, "stated", structure)
    if fit.levels is not None and fit.levels.approaches:
        return _judged(again, fixed, _at_most(stage, fit, again, noise), "measured", structure)
    usual = usual_repeatability(stage.model.robot.reach).worst
    left = hypot(again, fixed) or _widened(stage, fit, noise)
    return _judged(0.0, left, usual, "assumed", structure)


def _judged(arm: float, beyond: float, limit: float, source: Source, structure: bool) -> Rest:
    """What remains, the arm's own scatter and what lies beyond it, against what arms repeat to."""
    size, large = hypot(arm, beyond), beyond > _NO_LARGER * limit
    if structure or large:
        return Rest(size, "structure" if structure else "too_large", "model", limit, source)
    if not size:
        return Rest(0.0, "none", "instrument", limit, source)
    return Rest(size, "scatter", "undecided" if source == "assumed" else "arm", limit, source)


def _size(stage: Stage, variances: Array) -> float:
    """One coordinate, m, of a point; of the tip where no reading is a length."""
    if not stage.model.readout.channels.metric:
        return stage.scatter.of_tip(variances).translation
    seen = stage.data.seen & stage.model.readout.channels.lengths.any(axis=-1)
    each = stage.model.readout.channels.numbers_each(seen)
    return float(np.sqrt(stage.scatter.point_variance(variances)[seen].mean() / each))


def _at_most(stage: Stage, fit: Fit, again: float, noise: NoiseLevel) -> float:
    """The largest repeatability that second approaches do not contradict (95 %), m per coordinate.

    Of markers that move together the mean is read: its noise is that of one over their number.
    """
    from scipy.special import chdtri

    kept = ~stage.dropped
    approaches = np.unique(stage.scatter.approach[kept])
    configurations = np.unique(stage.data.poses.configuration[kept])
    dof = _COORDINATES * max(len(approaches) - len(configurations), 1)
    points = stage.data.seen[kept].sum(axis=1).mean()
    read = noise.sigma * fit.model.footprint(fit.values, stage.data) / np.sqrt(points)
    most = (again**2 + read**2) * dof / float(chdtri(dof, 0.95)) - read**2
    return float(np.sqrt(max(most, again**2)))


def _widened(stage: Stage, fit: Fit, noise: NoiseLevel) -> float:
    """What a residual errs by beyond the instrument, m, where nothing tells both apart."""
    if noise.source != "residual" or noise.factor <= 1.0:
        return 0.0
    size = noise.believed * float(np.sqrt(noise.factor**2 - 1.0))
    return size * fit.model.footprint(fit.values, stage.data)


def beyond_blunders(left_out: int, poses: int) -> bool:
    """Whether more poses were left out than blunders explain."""
    return left_out > max(1.0, _BLUNDERS * poses)
