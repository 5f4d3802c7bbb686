"""The levels of noise: the instrument at each point, the arm at each approach, the rest at each place.

A reading of approach a in configuration k errs by ``J_k (c_k + u_a) + e``: e is the instrument's and
new at every point, u_a the arm's repeatability and new at every approach, c_k what no model follows
from one configuration to the next: it comes again at the same joints and tells nothing of others.
J_k moves the joints and the tip, so a handful of variances says it all. They are estimated in
:mod:`calib.identification.estimate`; :class:`calib.scatter.Scatter` makes the rows of whole poses
independent.
"""

from calib.scatter.estimate import ScatterLevel, Undetected, VarianceEstimate
from calib.scatter.poses import Scatter, Variances, scatter_of, scatter_variance

__all__ = [
    "Scatter",
    "ScatterLevel",
    "Undetected",
    "VarianceEstimate",
    "Variances",
    "scatter_of",
    "scatter_variance",
]
