"""doe: which poses to measure, and a proof of how good they are.

plan = design(cell, poses=20, criterion="task")
plan.poses, plan.efficiency
"""

from doe.design import design
from doe.discriminate import NextPoses, next_poses
from doe.plan import Design
from doe.problem.refusals import CannotIdentify

__all__ = ["CannotIdentify", "Design", "NextPoses", "design", "next_poses"]
