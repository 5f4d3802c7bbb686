"""The levels of noise: the instrument at each point, the arm at each approach, the rest at each place.

A reading of approach a in configuration k errs by ``J_k (c_k + u_a) + e``: e is the instrument's and
new at every point, u_a the arm's repeatability and new at every approach, c_k what no model follows
from one configuration to the next: it comes again at the same joints and tells nothing of others.
J_k moves the joints and the tip, so a handful of variances says it all. This package estimates them
for the diagnosis (:mod:`calib.scatter.restricted`, :mod:`calib.scatter.search`), and makes the rows of
whole poses independent (:class:`calib.scatter.Scatter`).
"""

from calib.scatter.poses import Scatter, Variances, scatter_of, scatter_variance
from calib.scatter.search import Undetected, VarianceEstimate, levels_of

__all__ = [
    "Scatter",
    "Undetected",
    "VarianceEstimate",
    "Variances",
    "levels_of",
    "scatter_of",
    "scatter_variance",
]
