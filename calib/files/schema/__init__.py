"""The cell file as it is written: units in the names, checked before anything is computed."""

from calib.files.schema.camera import CameraTable, IntrinsicsStd
from calib.files.schema.carried import LoadTable
from calib.files.schema.cell import CellFile
from calib.files.schema.design import Box, DesignTable, HalfSpace, LevelsTable, Sphere
from calib.files.schema.instruments import KINDS, AngleTable, InstrumentTable, PoseTable
from calib.files.schema.markers import BoardTable, BodyTable, MarkerTable
from calib.files.schema.model import AcceptanceTable, PriorTable
from calib.files.schema.noise import DIVISORS, CommonTable, LimitTable, MpeSigma, PolarSigma, Sigma
from calib.files.schema.robot import RobotTable
from calib.files.schema.touching import DistanceTable, PlaneTable, SocketTable, SphereTable

__all__ = [
    "DIVISORS",
    "KINDS",
    "AcceptanceTable",
    "AngleTable",
    "BoardTable",
    "BodyTable",
    "Box",
    "CameraTable",
    "CellFile",
    "CommonTable",
    "DesignTable",
    "DistanceTable",
    "HalfSpace",
    "InstrumentTable",
    "IntrinsicsStd",
    "LevelsTable",
    "LimitTable",
    "LoadTable",
    "MarkerTable",
    "MpeSigma",
    "PlaneTable",
    "PolarSigma",
    "PoseTable",
    "PriorTable",
    "RobotTable",
    "Sigma",
    "SocketTable",
    "Sphere",
    "SphereTable",
]
