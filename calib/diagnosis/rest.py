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
from calib.diagnosis.finding import Finding
from calib.diagnosis.gap import beyond_noise
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise import NoiseLevel
from calib.observations.scatter import Owner
from calib.poses import Measurements

Kind = Literal["none", "scatter", "structure", "too_large"]
Source = Literal["stated", "measured", "assumed"]

_NO_LARGER = 1.25  # times a repeatability that is known: what remains is an estimate
_COORDINATES = 3  # of the tip that an approach shows
_BROKEN = 10.0  # times the worst data sheet: whatever does so is not how an arm repeats
_BLUNDERS = 0.05  # of the poses: more that were left out are none


@dataclass(frozen=True)
class Rest:
    """The error that remains once every cause found is in the model.

    size : float, m; of : whose it is
    repeatability : float, m, of the arm by this source
    """

    size: float
    kind: Kind
    of: Owner
    repeatability: float
    source: Source

    @property
    def closed(self) -> bool:
        """Whether it is nothing, or what such an arm scatters by anyway."""
        return self.kind in ("none", "scatter")


def rest_of(
    finding: Finding, smooth: bool, left_out: int, heldout: Measurements | None = None
) -> Rest:
    """Size and kind of the error that remains beside all causes found.

    smooth : whether a cause is there in another form, or what passes for scatter runs with something
    left_out : poses that count as blunders
    heldout : what these err by beyond all that is expected remains as well
    """
    structure = smooth or _has_place(finding, left_out)
    rest = _judged(finding, structure)
    if heldout is None:
        return rest
    numbers = finding.stage.model.readout.channels.numbers_each(heldout.seen)
    expected = hypot(finding.floor, rest.size * float(np.sqrt(numbers)))
    more = beyond_noise(finding.after, heldout, expected)
    return rest if more is None else _judged(finding, structure, more)


def _has_place(finding: Finding, left_out: int) -> bool:
    """Whether what remains is more than scatter: a part of it follows a column, or single poses."""
    stage, after = finding.stage, finding.after
    curves = any(not c.named for c in finding.outcome.active)
    blunders = left_out <= max(1.0, _BLUNDERS * len(stage.data))
    scatters = bool(after.variances.configuration.any())
    no_help = any(r.why == "configurations" for r in finding.refused)
    in_vain = no_help and not (finding.outcome.active or scatters)
    return curves or not blunders or in_vain


def _judged(finding: Finding, structure: bool, more: float = 0.0) -> Rest:
    """What remains, against what the arm repeats to.

    more : m per coordinate, beyond what the fitted poses show
    """
    stage, fit, noise = finding.stage, finding.after, finding.noise
    each = (fit.variances.approach, fit.variances.configuration)
    arm, fixed = (_size(stage, v) for v in each)
    fixed = hypot(fixed, more)
    size = hypot(arm, fixed)
    again = fit.levels is not None and fit.levels.approaches
    source: Source = "stated" if stage.arm is not None else "measured" if again else "assumed"
    match source:
        case "stated":
            large = fixed > _NO_LARGER * arm
        case "measured":
            large = fixed > _at_most(stage, fit, arm, noise)
            large = large or arm > _BROKEN * usual_repeatability(stage.model.robot.reach).worst
        case "assumed":
            arm = usual_repeatability(stage.model.robot.reach).worst
            if not size and noise.source == "residual" and noise.factor > 1.0:
                # Beyond the instrument, where nothing tells both apart.
                beyond = noise.believed * float(np.sqrt(noise.factor**2 - 1.0))
                size = beyond * fit.model.footprint(fit.values, stage.data)
            large = size > _NO_LARGER * arm
    if structure or large:
        return Rest(size, "structure" if structure else "too_large", "model", arm, source)
    if not size:
        return Rest(0.0, "none", "instrument", arm, source)
    return Rest(size, "scatter", "undecided" if source == "assumed" else "arm", arm, source)


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
