"""Which motions to log: drawn within the robot's limits, chosen by what they tell of the torque."""

from doe.motions.design import MotionDesign, design_motions

__all__ = ["MotionDesign", "design_motions"]
