"""Identification: from measured points to parameters with honest uncertainties.

Read in the order in which :mod:`~calib.identification.identify` calls them: ``checks`` refuses,
``start`` places instruments and markers, ``mistakes`` tries the entries of ``slips``, ``tuning`` scans
(``scan``), ``sizes`` weighs priors in, ``fit`` searches with ``estimators`` and ``outliers``,
``noise_scales`` and ``components`` estimate variances, ``residuals`` and ``identification`` are the
result.
"""

from calib.identification.identification import ADVICE, Identification
from calib.identification.residuals import Residuals

__all__ = ["ADVICE", "Identification", "Residuals"]
