"""Performance criteria of ISO 9283:1998, measured from repeats and predicted from a model."""

from calib.iso9283.measured import Measured, measured
from calib.iso9283.predicted import Predicted, predicted

__all__ = ["Measured", "Predicted", "measured", "predicted"]
