"""The instruments that posecal knows: one file each, all behind one protocol."""

from calib.instruments.angle import Angle
from calib.instruments.camera import ArmCamera, Camera, FixedCamera
from calib.instruments.channels import Channels
from calib.instruments.distance import Distance
from calib.instruments.known_distances import KnownDistance
from calib.instruments.plane import Plane
from calib.instruments.points import TRACKER, Tracker
from calib.instruments.pose import Pose
from calib.instruments.protocol import Instrument
from calib.instruments.socket import Socket
from calib.instruments.sphere import Sphere

__all__ = [
    "TRACKER",
    "Angle",
    "ArmCamera",
    "Camera",
    "Channels",
    "Distance",
    "FixedCamera",
    "Instrument",
    "KnownDistance",
    "Plane",
    "Pose",
    "Socket",
    "Sphere",
    "Tracker",
]
