"""What a plan can tell of causes that no model has yet: sizes, hidden causes, look-alikes."""

from doe.foresight.foresee import Foresight
from doe.foresight.sight import Sight

__all__ = ["Foresight", "Sight"]
