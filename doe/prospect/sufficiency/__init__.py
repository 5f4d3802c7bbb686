"""Whether the poses measured so far are enough, and in which order to measure the rest of the plan."""

from doe.prospect.sufficiency.answer import Enough
from doe.prospect.sufficiency.forecast import Step

__all__ = ["Enough", "Step"]
