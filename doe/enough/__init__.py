"""Whether the poses measured so far are enough, and in which order to measure the rest of the plan."""

from doe.enough.answer import Enough
from doe.enough.enough import enough
from doe.enough.forecast import Step

__all__ = ["Enough", "Step", "enough"]
