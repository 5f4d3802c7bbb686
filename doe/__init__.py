"""doe: which poses to measure, and a proof of how good they are.

Before the day, a plan and what it will see; on the day, whether what was measured is enough:

    import calib
    import doe

    cell = calib.load_cell("cell.toml")
    plan = doe.design(cell, poses=15, criterion="D", candidates=1000)
    plan.efficiency, plan.poses.q

    data = calib.load_measurements(cell, "measurements.csv")
    left = doe.enough(cell, data)

``efficiency`` is proved: at least this fraction of the best that any plan of these candidates reaches.
``doe.foresee(cell, plan.poses)`` says which causes a plan could show, and ``doe.next_poses(cell,
calib.diagnose(cell, data))`` which poses tell the causes apart that the data cannot;
``doe.onward(cell, data)`` the next few poses for either, in a loop with the robot in between.
"""

from doe.ahead.enough import Enough, enough
from doe.ahead.foresee import PowerAnalysis, foresee
from doe.ahead.next_poses import NextPoses, next_poses
from doe.ahead.onward import Onward, onward
from doe.plan import Design
from doe.planning import design
from doe.problem.request import CannotIdentify

__all__ = [
    "CannotIdentify",
    "Design",
    "Enough",
    "NextPoses",
    "Onward",
    "PowerAnalysis",
    "design",
    "enough",
    "foresee",
    "next_poses",
    "onward",
]
