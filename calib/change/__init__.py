"""What changed between two results of one robot, and whether its calibration still holds."""

from calib.change.comparison import Changes, changes
from calib.change.known import DayEstimate, known_of

__all__ = ["Changes", "DayEstimate", "changes", "known_of"]
