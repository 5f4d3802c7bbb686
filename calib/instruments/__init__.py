"""The instruments that posecal knows: one file each, all behind one protocol."""

from calib.instruments.camera import ArmCamera, Camera, FixedCamera
from calib.instruments.camera_table import CameraTable
from calib.instruments.channels import Channels, KnownDistance
from calib.instruments.distance import Distance, DistanceTable
from calib.instruments.plane import Plane, PlaneTable
from calib.instruments.points import TRACKER, PointsTable, Tracker
from calib.instruments.pose import Pose, PoseTable
from calib.instruments.protocol import CellParts, Instrument, KeysTable
from calib.instruments.socket import Socket, SocketTable

KINDS: dict[str, tuple[type[Instrument], type[KeysTable]]] = {
    own.kind: (own, table)
    for own, table in (
        (Tracker, PointsTable),
        (FixedCamera, CameraTable),
        (Distance, DistanceTable),
        (Plane, PlaneTable),
        (Pose, PoseTable),
        (Socket, SocketTable),
    )
}
"""Every kind as a cell names it: its class, and its keys in a cell, which make one."""

__all__ = [
    "KINDS",
    "TRACKER",
    "ArmCamera",
    "Camera",
    "CellParts",
    "Channels",
    "Distance",
    "FixedCamera",
    "Instrument",
    "KeysTable",
    "KnownDistance",
    "Plane",
    "Pose",
    "Socket",
    "Tracker",
]
