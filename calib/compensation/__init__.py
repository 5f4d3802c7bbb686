"""Joint commands with which the real arm stands where the nominal one should; what error remains."""

from calib.compensation.commands import Compensation, compensate
from calib.compensation.estimate import Estimate, estimate_of

__all__ = ["Compensation", "Estimate", "compensate", "estimate_of"]
