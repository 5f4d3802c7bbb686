"""What changed between two results of one robot, and whether its calibration still holds."""

from calib.change.between import Changes, changes
from calib.change.known import COORDINATES, Known, approaches, beyond, known_of

__all__ = ["COORDINATES", "Changes", "Known", "approaches", "beyond", "changes", "known_of"]
