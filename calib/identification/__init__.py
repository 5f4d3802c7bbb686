"""Identification: from measured points to parameters with honest uncertainties."""

from calib.identification.identification import ADVICE, Identification, Residuals

__all__ = ["ADVICE", "Identification", "Residuals"]
