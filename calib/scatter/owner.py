"""What a fit leaves from pose to pose beside the instrument's noise, and whose it is.

Poses that are approached again, or the cell, tell how the arm comes back to a pose. What differs from
configuration to configuration beside that comes again at the same joints: it is systematic, and so it
is the model's. Where nothing tells the arm from the model, data sheets of arms of its size do: more
than the worst of them is the model's as well, less is undecided.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from calib.arm.repeatability import Usual, usual_repeatability
from calib.cell import Repeatability
from calib.scatter import Scatter, VarianceEstimate, Variances

Owner: TypeAlias = Literal["instrument", "arm", "model", "undecided"]


@dataclass(frozen=True)
class PoseToPose:
    """How poses err as a whole: one coordinate of the tip, m, and of its rotation, rad.

    arm : from approach to approach; None where neither the data nor the cell tell it
    rest : from configuration to configuration; where ``arm`` is None, both; None where there is none
    usual : Usual, how arms of this size repeat by data sheets
    """

    arm: Repeatability | None
    rest: Repeatability | None
    usual: Usual

    @property
    def of(self) -> Owner:
        """Whose the rest is; where there is none, who is all that errs."""
        if self.rest is None:
            return "instrument" if self.arm in (None, Repeatability(0.0, 0.0)) else "arm"
        if self.arm is not None or self.rest.translation > self.usual.worst:
            return "model"
        return "undecided"


def pose_to_pose(
    levels: VarianceEstimate | None, scatter: Scatter | None, reach: float
) -> PoseToPose:
    """The judgement of a fit's levels of noise.

    scatter : of the same readings; reach : m, of the arm (:attr:`calib.arm.robot.Robot.reach`)
    """
    usual = usual_repeatability(reach)
    if levels is None or scatter is None:
        return PoseToPose(None, None, usual)
    v = levels.variances
    shown = levels.approaches or bool(v.approach.any())
    rest = scatter.of_tip(v.configuration) if v.configuration.any() else None
    return PoseToPose(scatter.of_tip(v.approach) if shown else None, rest, usual)


def parted(variances: Variances, of: Owner) -> tuple[Variances, Variances]:
    """The variances that are the arm's, and those that are the model's.

    of : whose those of the configurations are; what is undecided counts as the arm's
    """
    none = np.zeros_like(variances.configuration)
    if of != "model":
        return variances, replace(variances, approach=none, configuration=none)
    return replace(variances, configuration=none), replace(variances, approach=none)
