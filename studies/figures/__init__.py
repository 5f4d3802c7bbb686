"""Figures: functions ``(result) -> Figure`` in one style, that templates name."""

from studies.figures.arm import arm as arm
from studies.figures.diagnosis import causes as causes
from studies.figures.diagnosis import located_curve as located_curve
from studies.figures.errors import errors_against as errors_against
from studies.figures.errors import errors_by_pose as errors_by_pose
from studies.figures.parameters import certificate as certificate
from studies.figures.parameters import deviations as deviations
from studies.figures.parameters import deviations_by_approach as deviations_by_approach
from studies.figures.parameters import ellipses as ellipses
from studies.figures.parameters import predicted_deviations as predicted_deviations
