"""The levels of noise: the instrument at each point, the arm at each approach, the rest at each place.

A reading of approach a in configuration k errs by ``J_k (c_k + u_a) + e``: e is the instrument's and
new at every point, u_a the arm's repeatability and new at every approach, c_k what no model follows
from one configuration to the next: it comes again at the same joints and tells nothing of others.
J_k moves the joints and the tip, so a handful of variances says it all. This package estimates them
(:mod:`calib.scatter.restricted`, :mod:`calib.scatter.search`), averages over those that it did not
find (:mod:`calib.scatter.search`), and is the one place that whitens whole poses
(:class:`calib.scatter.Scatter`).
"""

from calib.scatter.poses import Scatter, Variances, scatter_of
from calib.scatter.search import Unnoticed, VarianceEstimate, levels_of, unnoticed

__all__ = [
    "Scatter",
    "Unnoticed",
    "VarianceEstimate",
    "Variances",
    "levels_of",
    "scatter_of",
    "unnoticed",
]
