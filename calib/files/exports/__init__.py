"""Exports of instruments and controllers, read and joined into one table of measurements."""

from calib.files.exports.join import Joined, join
from calib.files.exports.joints import JointTable, read_joints
from calib.files.exports.points import PointList, read_points

__all__ = ["Joined", "JointTable", "PointList", "join", "read_joints", "read_points"]
