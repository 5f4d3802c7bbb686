"""Residuals and their derivatives under the paper's two approaches, weighted by the noise.

``points`` (approach #2) compares marker coordinates; ``pose`` (approach #1) first condenses the markers
of a reading to position and orientation of the tip frame. Both are a linear problem about a fit
(:mod:`~calib.observations.linear`), whose rows may err together (:mod:`~calib.observations.scatter`).
"""

from typing import Literal

from calib.observations.points import Observation, Points, points_of
from calib.observations.pose import PoseObservation, Weighting, as_poses
from calib.observations.shape import orientable, pose_from_points, with_measured_shape

Approach = Literal["points", "pose"]

__all__ = [
    "Approach",
    "Observation",
    "Points",
    "PoseObservation",
    "Weighting",
    "as_poses",
    "orientable",
    "points_of",
    "pose_from_points",
    "with_measured_shape",
]
