"""The instruments that posecal knows: one file each, all behind one protocol."""

from calib.instruments.camera import ArmCamera, Camera, CameraTable, FixedCamera
from calib.instruments.channels import Channels, KnownDistance
from calib.instruments.distance import Distance, DistanceTable
from calib.instruments.keys_table import CellParts, KeysTable
from calib.instruments.plane import Plane, PlaneTable
from calib.instruments.pose import Pose, PoseTable
from calib.instruments.protocol import Instrument
from calib.instruments.socket import Socket, SocketTable
from calib.instruments.tracker import TRACKER, PointsTable, Tracker

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
