"""Performance criteria of ISO 9283:1998, measured from repeats and predicted from a model."""

from calib.iso9283.measured import MarkerReadings, MeasuredCriteria, session_of
from calib.iso9283.predicted import PredictedCriteria

__all__ = ["MarkerReadings", "MeasuredCriteria", "PredictedCriteria", "session_of"]
