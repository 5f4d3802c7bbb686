"""The one linear mixed model: design, variances, and every question that is asked of them.

Read in this order: :mod:`~calib.inference.design` states the model, ``turned`` and ``decorrelation``
make its rows independent, ``restricted`` gives the likelihood, ``prior`` and ``reml`` the variances,
``marginal`` and ``evidence`` what follows from them. ``robust``, ``leave_out`` and ``widths`` each are
one procedure on a design; ``least_squares`` and ``tails`` are plain numerics.
"""

from calib.inference.design import Design, GaussianBlock, RandomEffect, Variances
from calib.inference.evidence import Evidence
from calib.inference.leave_out import LeftOut, leave_groups_out
from calib.inference.marginal import Marginal
from calib.inference.prior import Prior
from calib.inference.robust import pose_weights, robust_reml
from calib.inference.widths import Widths

__all__ = [
    "Design",
    "Evidence",
    "GaussianBlock",
    "LeftOut",
    "Marginal",
    "Prior",
    "RandomEffect",
    "Variances",
    "Widths",
    "leave_groups_out",
    "pose_weights",
    "robust_reml",
]
