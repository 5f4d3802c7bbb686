"""The causes of error that posecal knows: a class each, and one entry here.

A user's own effect is the same small class in an installed package of theirs, announced in its
``pyproject.toml`` under ``[project.entry-points."posecal.effects"]`` by the name that a cell gives it.
"""

from __future__ import annotations

from functools import lru_cache

from calib.effects.camera import Distortion, Focal, PrincipalPoint
from calib.effects.context import Context
from calib.effects.elastic import (
    BaseCompliance,
    BearingCompliance,
    JointCompliance,
    StiffnessVsAngle,
    ToolCompliance,
)
from calib.effects.geometry import Geometry, LinkGeometry
from calib.effects.joint import (
    Backlash,
    JointCoupling,
    JointOffset,
    MeasuredTorque,
    Settling,
    TransmissionHarmonic,
    TransmissionScale,
)
from calib.effects.loads import (
    FrictionWindup,
    GravityCompensator,
    GravitySag,
    LinkWeight,
    PayloadError,
)
from calib.effects.protocol import Effect, Parameter, State
from calib.effects.readings import BoardScale, TrackerScale
from calib.effects.ripple import GearRipple
from calib.effects.thermal import ThermalExpansion
from calib.effects.timed import BaseDrift, Step, TrackerDrift, WarmUp
from calib.effects.tool_base import Base, Tool
from calib.plugins import with_announced

_KINDS: tuple[type[Effect], ...] = (
    *(Base, Tool, Geometry, JointOffset, LinkGeometry, JointCompliance, StiffnessVsAngle),
    *(GravityCompensator, GravitySag, LinkWeight, PayloadError, TransmissionHarmonic),
    *(TransmissionScale, JointCoupling, Backlash, BearingCompliance, BaseCompliance, BaseDrift),
    *(ThermalExpansion, ToolCompliance, TrackerScale, TrackerDrift, GearRipple, WarmUp, Step),
    *(Settling, FrictionWindup, MeasuredTorque, Focal, PrincipalPoint, Distortion, BoardScale),
)
EFFECTS: dict[str, type[Effect]] = {effect.kind: effect for effect in _KINDS}
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
