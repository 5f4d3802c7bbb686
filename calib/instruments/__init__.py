"""The instruments that posecal knows: one file each, all behind one protocol."""

from calib.instruments.channels import Channels
from calib.instruments.points import TRACKER, Tracker
from calib.instruments.pose import Pose
from calib.instruments.protocol import Instrument

__all__ = ["TRACKER", "Channels", "Instrument", "Pose", "Tracker"]
