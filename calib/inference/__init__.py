"""The one linear mixed model: design, variances, and every question that is asked of them.

Read in this order: :mod:`~calib.inference.design` states the model, ``turned`` and ``decorrelation``
make its rows independent, ``restricted`` gives the likelihood, ``prior`` and ``reml`` the variances,
``marginal`` and ``evidence`` what follows from them. ``widths`` finds how large errors of a kind are,
``leave_out`` predicts groups of rows by the others; ``coverage``, ``least_squares`` and ``tails`` are
plain numerics.
"""

from calib.inference.design import Design, GaussianBlock, RandomEffect, Variances
from calib.inference.marginal import Marginal
from calib.inference.prior import Prior

__all__ = [
    "Design",
    "GaussianBlock",
    "Marginal",
    "Prior",
    "RandomEffect",
    "Variances",
]
