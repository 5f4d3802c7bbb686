"""Exports of instruments and controllers, read and joined into one table of measurements."""

from calib.files.exports.join import Joined
from calib.files.exports.joints import JointTable, read_joints
from calib.files.exports.points import PointList, read_points

__all__ = ["Joined", "JointTable", "PointList", "read_joints", "read_points"]
