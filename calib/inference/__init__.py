"""The one linear mixed model: design, variances, and every question that is asked of them.

Read in this order: :mod:`~calib.inference.design` states the model, ``turned`` and ``decorrelation``
make its rows independent, ``restricted`` gives the likelihood, ``reml`` the variances and what follows.
``evidence`` tests columns, ``widths`` estimates how large errors of a kind are, ``leave_out`` predicts
groups of rows by the others; ``coverage`` and ``least_squares`` are plain numerics.
"""

from calib.inference.design import Design, GaussianBlock, RandomEffect, Variances
from calib.inference.reml import Marginal, Prior

__all__ = [
    "Design",
    "GaussianBlock",
    "Marginal",
    "Prior",
    "RandomEffect",
    "Variances",
]
