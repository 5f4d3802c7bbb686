"""Identification: from measured points to parameters with honest uncertainties."""

from calib.identification.identification import ADVICE, Identification
from calib.identification.residuals import Residuals

__all__ = ["ADVICE", "Identification", "Residuals"]
