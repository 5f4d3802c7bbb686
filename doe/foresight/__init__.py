"""What a plan can tell of causes that no model has yet: sizes, hidden causes, look-alikes."""

from doe.foresight.fields import foresight_fields
from doe.foresight.foresee import Foresight, foresee
from doe.foresight.sight import Sight

__all__ = ["Foresight", "Sight", "foresee", "foresight_fields"]
