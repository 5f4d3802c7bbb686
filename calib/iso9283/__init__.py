"""Performance criteria of ISO 9283:1998, measured from repeats and predicted from a model."""

from calib.iso9283.measured import Measured, Session, session_of
from calib.iso9283.predicted import Predicted

__all__ = ["Measured", "Predicted", "Session", "session_of"]
