"""What changed between two results of one robot, and whether its calibration still holds."""

from calib.change.changes import Changes, changes
from calib.change.known import Known, freedom, known_of

__all__ = ["Changes", "Known", "changes", "freedom", "known_of"]
