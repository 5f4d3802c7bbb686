"""What changed between two results of one robot, and whether its calibration still holds."""

from calib.change.between import Changes, changes
from calib.change.known import Known, approaches, beyond, freedom, known_of

__all__ = ["Changes", "Known", "approaches", "beyond", "changes", "freedom", "known_of"]
