"""Identification: from measured points to parameters with honest uncertainties.

Read in the order in which :mod:`~calib.identification.identify` calls them: ``checks`` refuses,
``start`` places instruments and markers, ``mistakes`` tries the entries of ``data_mistakes``,
``tuning`` scans (``scan``), ``estimate`` fits (``fit``, with ``outliers``), weighs by the ``noise`` and
finds variances and sizes of errors; ``residuals`` and ``identification`` are the result.
"""

from calib.identification.identification import ADVICE, Identification
from calib.identification.residuals import Residuals

__all__ = ["ADVICE", "Identification", "Residuals"]
