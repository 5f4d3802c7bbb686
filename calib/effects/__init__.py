"""The causes of error that posecal knows: a class each, and one entry here.

A user's own effect is the same small class in an installed package of theirs, announced in its
``pyproject.toml`` under ``[project.entry-points."posecal.effects"]`` by the name that a cell gives it.
"""

from __future__ import annotations

from functools import lru_cache

from calib.effects.base import Base
from calib.effects.board import BoardScale
from calib.effects.compliance import (
    BaseCompliance,
    BearingCompliance,
    JointCompliance,
    MeasuredTorque,
    ToolCompliance,
)
from calib.effects.context import Context
from calib.effects.drift import BaseDrift, TrackerDrift
from calib.effects.gear_ripple import GearRipple
from calib.effects.geometry import Geometry, JointOffset, LinkGeometry
from calib.effects.gravity_compensator import GravityCompensator
from calib.effects.gravity_sag import GravitySag
from calib.effects.instrument_scale import TrackerScale
from calib.effects.last_move import Backlash, FrictionWindup, Settling
from calib.effects.lens import Distortion, Focal, PrincipalPoint
from calib.effects.link_growth import ThermalExpansion
from calib.effects.mass import LinkWeight, PayloadError
from calib.effects.protocol import Effect, Parameter, State
from calib.effects.step import Step
from calib.effects.stiffness_vs_angle import StiffnessVsAngle
from calib.effects.tool import Tool
from calib.effects.transmission import JointCoupling, TransmissionHarmonic, TransmissionScale
from calib.effects.warm_up import WarmUp
from calib.plugins import with_announced

EFFECTS: dict[str, type[Effect]] = {
    effect.kind: effect
    for effect in (
        Base,
        Tool,
        Geometry,
        JointOffset,
        LinkGeometry,
        JointCompliance,
        StiffnessVsAngle,
        GravityCompensator,
        GravitySag,
        LinkWeight,
        PayloadError,
        TransmissionHarmonic,
        TransmissionScale,
        JointCoupling,
        Backlash,
        BearingCompliance,
        BaseCompliance,
        BaseDrift,
        ThermalExpansion,
        ToolCompliance,
        TrackerScale,
        TrackerDrift,
        GearRipple,
        WarmUp,
        Step,
        Settling,
        FrictionWindup,
        MeasuredTorque,
        Focal,
        PrincipalPoint,
        Distortion,
        BoardScale,
    )
}
"""Every cause by the name that a cell gives it, in the order in which they are shown."""

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
