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
``doe.foresee(cell, plan.poses)`` says which causes a plan could show, and ``doe.design(cell, poses=4,
extend="measurements.csv", discriminate=(a, b))`` which poses tell two of them apart.
``doe.design_motions(cell, 5)`` chooses motions that show what makes the joint torques.
"""

from doe.forecast.enough import Enough, enough
from doe.forecast.foresee import PowerAnalysis, foresee
from doe.motions import MotionDesign, design_motions
from doe.plan import Design
from doe.planning import design
from doe.request import CannotIdentify

__all__ = [
    "CannotIdentify",
    "Design",
    "Enough",
    "MotionDesign",
    "PowerAnalysis",
    "design",
    "design_motions",
    "enough",
    "foresee",
]
