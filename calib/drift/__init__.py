"""Whether anything moved through the day, from readings repeated at equal joints; no model needed."""

from calib.drift.check import DriftTest, Rate, Verdict, drift_in, drift_of
from calib.drift.series import Motion, Series

__all__ = ["DriftTest", "Motion", "Rate", "Series", "Verdict", "drift_in", "drift_of"]
