"""Data that cannot be meant as they read: which mistake would explain them, said in one line."""

from calib.identification.mistakes.recognise import (
    Mistake,
    recognised,
    refuse_mistakes,
    refuse_unreachable,
)
from calib.identification.mistakes.table import Slip, slips

__all__ = ["Mistake", "Slip", "recognised", "refuse_mistakes", "refuse_unreachable", "slips"]
