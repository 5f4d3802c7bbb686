"""doe: which poses to measure, and a proof of how good they are.

plan = design(cell, poses=20, criterion="task")
plan.poses, plan.efficiency
"""

from doe.design import design
from doe.plan import Design
from doe.refusals import CannotIdentify

__all__ = ["CannotIdentify", "Design", "design"]
