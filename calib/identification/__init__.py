"""Identification: from measured points to parameters with honest uncertainties.

Read in the order in which :mod:`~calib.identification.identify` calls them: ``checks`` refuses,
``start`` places instruments and markers, ``mistakes`` tries the entries of ``data_mistakes``,
``tuning`` scans (``scan``), ``estimate`` fits (``fit``, with ``estimators`` and ``outliers``), finds
variances (``noise_scales``, ``components``, ``noise_level``) and weighs sizes of errors in;
``residuals`` and ``identification`` are the result.
"""

from calib.identification.identification import ADVICE, Identification
from calib.identification.residuals import Residuals

__all__ = ["ADVICE", "Identification", "Residuals"]
