"""How well arms come back to a pose, by their data sheets: what to expect where nothing measured it.

Data sheets give ISO 9283's RP, the mean distance from the barycentre plus three of its standard
deviations. Where the three coordinates scatter alike with a standard deviation s, the distance is
Maxwell's: its mean is ``sqrt(8 / pi) s``, its variance ``(3 - 8 / pi) s^2``.

RP by size of the arm, mm, of data sheets: Meca500 0.005, IRB 120 0.01, UR3e 0.03 (0.3 to 0.6 m);
TX2-60 0.02, UR5e 0.03, Panda 0.1, LBR iiwa 14 0.15 (0.7 to 0.9 m); UR10e 0.05, UR10 0.1, MA1400 0.08
(1.3 to 1.4 m); R-2000iC 0.05, KR 270 R2700 0.06, R-2000iB 0.2 (2.7 m). Two lines enclose them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

_RP_IN_STD = sqrt(8.0 / pi) + 3.0 * sqrt(3.0 - 8.0 / pi)  # 3.62
_BEST = 0.015e-3  # m of RP a metre of arm
_WORST = 0.08e-3, 0.06e-3  # m of RP, and m a metre


@dataclass(frozen=True)
class Usual:
    """Between what arms of a size repeat: standard deviations of one coordinate of the tip, m."""

    best: float
    worst: float

    @property
    def middle(self) -> float:
        """As far above the best as below the worst, in ratio."""
        return sqrt(self.best * self.worst)


def usual_repeatability(size: float) -> Usual:
    """What data sheets of arms of a size say.

    size : m, as of :attr:`calib.arm.robot.Robot.reach`
    """
    intercept, slope = _WORST
    return Usual(_BEST * size / _RP_IN_STD, (intercept + slope * size) / _RP_IN_STD)
