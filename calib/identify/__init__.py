"""Identification: from measured points to parameters with honest uncertainties."""

from calib.identify.identification import ADVICE, Identification, Residuals
from calib.identify.identify import identify

__all__ = ["ADVICE", "Identification", "Residuals", "identify"]
