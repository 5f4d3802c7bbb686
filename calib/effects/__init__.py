"""The causes of error that posecal knows: one file each, and one entry here."""

from __future__ import annotations

from calib.effects.base import Base
from calib.effects.base_compliance import BaseCompliance
from calib.effects.bearing_compliance import BearingCompliance
from calib.effects.geometry import Geometry
from calib.effects.gravity_compensator import GravityCompensator
from calib.effects.joint_compliance import JointCompliance
from calib.effects.joint_offset import JointOffset
from calib.effects.link_geometry import LinkGeometry
from calib.effects.protocol import Context, Effect, Parameter, State
from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from calib.effects.tool import Tool
from calib.effects.tool_compliance import ToolCompliance

EFFECTS: dict[str, type[Effect]] = {
    "base": Base,
    "tool": Tool,
    "geometry": Geometry,
    "joint_offset": JointOffset,
    "link_geometry": LinkGeometry,
    "joint_compliance": JointCompliance,
    "stiffness_vs_angle": StiffnessVsAngle,
    "gravity_compensator": GravityCompensator,
    "bearing_compliance": BearingCompliance,
    "base_compliance": BaseCompliance,
    "tool_compliance": ToolCompliance,
}

GROUPS = ("base", "tool", "geometry")
"""Effects that a user's model may contain as a whole, and that have no places of their own."""

__all__ = ["EFFECTS", "GROUPS", "Context", "Effect", "Parameter", "State"]
