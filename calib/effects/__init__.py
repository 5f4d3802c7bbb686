"""The causes of error that posecal knows: one file each, and one entry here.

A user's own effect is the same small class in an installed package of theirs, announced in its
``pyproject.toml`` under ``[project.entry-points."posecal.effects"]`` by the name that a cell gives it.
"""

from __future__ import annotations

from functools import lru_cache

from calib.effects.backlash import Backlash
from calib.effects.base import Base
from calib.effects.base_compliance import BaseCompliance
from calib.effects.base_drift import BaseDrift
from calib.effects.bearing_compliance import BearingCompliance
from calib.effects.board_bend import BoardBend
from calib.effects.board_scale import BoardScale
from calib.effects.context import Context
from calib.effects.focal_drift import FocalDrift
from calib.effects.focal_expansion import FocalExpansion
from calib.effects.focal_scale import FocalScale
from calib.effects.friction_windup import FrictionWindup
from calib.effects.gear_ripple import GearRipple
from calib.effects.geometry import Geometry
from calib.effects.gravity_compensator import GravityCompensator
from calib.effects.gravity_sag import GravitySag
from calib.effects.instrument_drift import InstrumentDrift
from calib.effects.joint_compliance import JointCompliance
from calib.effects.joint_coupling import JointCoupling
from calib.effects.joint_offset import JointOffset
from calib.effects.lens import Distortion, Focal, PrincipalPoint
from calib.effects.link_geometry import LinkGeometry
from calib.effects.link_scale import LinkScale
from calib.effects.link_weight import LinkWeight
from calib.effects.measured_torque import MeasuredTorque
from calib.effects.moved import Moved
from calib.effects.payload import PayloadError
from calib.effects.protocol import Effect, Parameter, State
from calib.effects.settling import Settling
from calib.effects.socket_seat import SocketSeat
from calib.effects.step import Step
from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from calib.effects.thermal_expansion import ThermalExpansion
from calib.effects.time_offset import TimeOffset
from calib.effects.tool import Tool
from calib.effects.tool_compliance import ToolCompliance
from calib.effects.tracker_drift import TrackerDrift
from calib.effects.tracker_scale import TrackerScale
from calib.effects.transmission_harmonic import TransmissionHarmonic
from calib.effects.transmission_scale import TransmissionScale
from calib.effects.warm_up import WarmUp
from calib.effects.wire_scale import WireScale
from calib.plugins import with_announced

EFFECTS: dict[str, type[Effect]] = {
    "base": Base,
    "tool": Tool,
    "geometry": Geometry,
    "joint_offset": JointOffset,
    "link_geometry": LinkGeometry,
    "joint_compliance": JointCompliance,
    "stiffness_vs_angle": StiffnessVsAngle,
    "gravity_compensator": GravityCompensator,
    "gravity_sag": GravitySag,
    "link_weight": LinkWeight,
    "payload": PayloadError,
    "transmission_harmonic": TransmissionHarmonic,
    "transmission_scale": TransmissionScale,
    "joint_coupling": JointCoupling,
    "backlash": Backlash,
    "bearing_compliance": BearingCompliance,
    "base_compliance": BaseCompliance,
    "base_drift": BaseDrift,
    "thermal_expansion": ThermalExpansion,
    "tool_compliance": ToolCompliance,
    "tracker_scale": TrackerScale,
    "tracker_drift": TrackerDrift,
    "gear_ripple": GearRipple,
    "warm_up": WarmUp,
    "step": Step,
    "settling": Settling,
    "friction_windup": FrictionWindup,
    "measured_torque": MeasuredTorque,
    "focal": Focal,
    "principal_point": PrincipalPoint,
    "distortion": Distortion,
    "focal_scale": FocalScale,
    "focal_drift": FocalDrift,
    "focal_expansion": FocalExpansion,
    "link_scale": LinkScale,
    "board_scale": BoardScale,
    "board_bend": BoardBend,
    "moved": Moved,
    "time_offset": TimeOffset,
    "socket_seat": SocketSeat,
    "instrument_drift": InstrumentDrift,
    "wire_scale": WireScale,
}

ENDS = ("base", "tool")
"""Outer factors of the product: groups without places."""
GROUPS = (*ENDS, "geometry")
"""Effects of a user's model that are reduced together, and that are no causes."""


@lru_cache(maxsize=1)
def catalogue() -> dict[str, type[Effect]]:
    """All effects by name, ours and those of installed packages.

    Raises CalibError where a package announces something that is no effect.
    """
    return with_announced("effects", EFFECTS, Effect, lambda kind: kind.kind)


__all__ = ["EFFECTS", "ENDS", "GROUPS", "Context", "Effect", "Parameter", "State", "catalogue"]
