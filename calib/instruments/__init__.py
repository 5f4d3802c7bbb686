"""The instruments that posecal knows: one file each, all behind one protocol."""

from calib.instruments.points import TRACKER, Tracker
from calib.instruments.protocol import Instrument

__all__ = ["TRACKER", "Instrument", "Tracker"]
